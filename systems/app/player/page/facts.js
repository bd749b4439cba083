// The numbers beside the picture, as elements.
import {costsOfBodies} from './colours.js';

const mm = metres => `${(1e3 * metres).toPrecision(3)} mm`;
const newton = force => `${force.toPrecision(3)} N`;

// Passes count from 0, as in the rest of the page and in captures; the first frame of a run is before them.
export const nameOfPass = ({pass}) => pass > 0 ? `pass ${pass - 1}` : 'before the first pass';

function heading(text) {
    const made = document.createElement('h3');
    made.textContent = text;
    return made;
}

function table(rows) {
    const made = document.createElement('table');
    for (const [name, value] of rows) {
        const row = made.insertRow();
        row.insertCell().textContent = name, row.insertCell().textContent = value;
    }
    return made;
}

export function bodyFacts({header, meshes}, frame, body) {
    const {name, kind, mesh} = header.bodies[body], state = frame.bodies[body], costs = costsOfBodies(frame);
    const own = frame.contacts.filter(c => c.body === body || c.other === body), deepest = own.reduce((d, c) => Math.max(d, -c.distance), 0);
    const rows = [['kind', kind], ['vertices', meshes[mesh].count], ['triangles', meshes[mesh].triangles.length / 3]];
    if (!header.bodies[body].still) rows.push(['state', state.asleep ? 'asleep' : state.island < 0 ? 'awake' : `awake, island ${state.island}`]);
    rows.push(['contacts', own.length]);
    if (deepest > 0) rows.push(['deepest', mm(deepest)]);
    if (costs.has(body)) rows.push(['detection', `${costs.get(body).toFixed(3)} ms of this pass`]);
    return [heading(name), table(rows)];
}

export function contactFacts({header}, frame, index) {
    const c = frame.contacts[index], corners = [...new Set(c.vertices)];
    const rows = [['point of', header.bodies[c.body].name], [corners.length > 1 ? 'vertices' : 'vertex', corners.join(', ')],
                  ['against', header.bodies[c.other].name], [c.distance < 0 ? 'depth' : 'distance', mm(Math.abs(c.distance))],
                  ['normal', c.normal.map(x => x.toFixed(2)).join(', ')]];
    if (c.constrained) rows.push(['force', newton(c.push)], ['friction', newton(c.friction)]);
    else rows.push(['constraint', 'none']);
    return [heading('Contact'), table(rows)];
}

export function frameFacts({header}, frame) {
    const most = header.cells ? Infinity : 5;  // of stages and pairs: a capture is there to be looked into
    const deepest = frame.contacts.reduce((d, c) => Math.max(d, -c.distance), 0), islands = new Set(frame.bodies.map(b => b.island));
    islands.delete(-1);
    const kept = frame.contacts.length < frame.contactsFound ? `${frame.contactsFound}, the deepest ${frame.contacts.length} drawn` : frame.contactsFound;
    const rows = [['contacts', kept], ['deepest', deepest > 0 ? mm(deepest) : 'none'], ['islands', islands.size]];
    if (header.links) rows.push(['links', frame.links.length]);
    if (frame.cells) rows.push(['cells', frame.cells.length < frame.cellsFound ? `${frame.cellsFound}, ${frame.cells.length} drawn` : frame.cellsFound]);
    frame.tools.forEach((t, i) => rows.push([`hand at ${header.bodies[header.tools[i].body].name}`, newton(Math.hypot(...t.force))]));
    const parts = [heading(nameOfPass(frame).replace(/^./, first => first.toUpperCase())), table(rows)];
    const stages = frame.stages.map((ms, i) => [header.stages[i], ms]).sort((a, b) => b[1] - a[1]).slice(0, most).filter(s => s[1] > 0);
    if (stages.length > 0) {
        parts.push(heading(`Dearest stages of ${frame.ms.toFixed(2)} ms`), table(stages.map(([name, ms]) => [name, `${ms.toFixed(3)} ms`])));
    }
    if (frame.pairs.length > 0)
        parts.push(heading('Dearest pairs in detection'), table(frame.pairs.slice(0, most).map(p =>
            [`${header.bodies[p.a].name} / ${header.bodies[p.b].name}`, `${p.ms.toFixed(3)} ms, ${p.vertices} vertices`])));
    return parts;
}
