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

// A list whose rows are buttons: a click chooses what they stand for.
function choices(rows, select, chosen) {
    const made = document.createElement('table');
    made.className = 'choices';
    for (const {cells, hit} of rows) {
        const row = made.insertRow();
        for (const text of cells) row.insertCell().textContent = text;
        row.tabIndex = 0;
        row.onclick = () => select(hit);
        row.onkeydown = e => { if (e.key === 'Enter') select(hit); };
        if (chosen && JSON.stringify(hit) === JSON.stringify(chosen)) row.className = 'chosen';
    }
    return made;
}

const some = ({found, rows}) => rows.length < found ? `${found}, ${rows.length} listed` : `${found}`;

export function pairFacts({header}, frame, index) {
    const p = frame.inspection.pairs.rows[index], names = [p.a, p.b].map(b => header.bodies[b].name);
    return [heading(names.join(' / ')), table([['pairs of triangles that may cross', p.trianglePairs], ['vertices near the other', p.nearVertices],
        ['contacts', p.contacts], ['deepest', p.depth > 0 ? mm(p.depth) : 'no overlap'], ['constraints', p.constraints], ['sum of their forces', newton(p.force)]])];
}

export function islandFacts({header}, frame, index) {
    const island = frame.inspection.islands.rows[index], names = header.bodies.filter((_, b) => frame.bodies[b].island === index).map(b => b.name);
    return [heading(`Island ${index}`), table([['bodies', island.bodies], ['constraints', island.constraints]]),
            Object.assign(document.createElement('p'), {textContent: names.slice(0, 40).join(', ') + (names.length > 40 ? ' ...' : '')})];
}

// Stage by stage: what each left for the next, and lists to click on.
export function stageFacts({header}, frame, select, chosen) {
    const {inspection: n} = frame;
    if (!n) return [];
    const overlapping = n.pairs.rows.filter(p => p.depth > 0).length, name = body => header.bodies[body].name;
    const rows = [['boxes of bodies', some(n.boxes)], ['pairs of boxes that meet', n.boxPairs], ['candidate pairs of bodies', some(n.pairs)],
        ['cells that they share', frame.cellsFound], ['pairs of triangles that may cross', n.trianglePairs], ['vertices near a surface', n.nearVertices],
        ['contacts', frame.contactsFound], ['pairs that overlap', overlapping], ['constraints', n.constraints], ['of them that push', n.loaded], ['islands', some(n.islands)]];
    const parts = [heading('Stage by stage'), table(rows)];
    if (n.pairs.rows.length > 0)
        parts.push(heading('Candidate pairs'), choices(n.pairs.rows.map((p, pair) => ({hit: {pair}, order: p.nearVertices,
            cells: [`${name(p.a)} / ${name(p.b)}`, `${p.contacts} contacts`, p.depth > 0 ? mm(p.depth) : '', p.force > 0 ? newton(p.force) : '']}))
            .sort((a, b) => b.order - a.order).slice(0, 100), select, chosen));
    const constrained = frame.contacts.map((c, contact) => ({c, contact})).filter(({c}) => c.constrained).sort((a, b) => b.c.push - a.c.push);
    if (constrained.length > 0)
        parts.push(heading('Constraints that push most'), choices(constrained.slice(0, 20).map(({c, contact}) => ({hit: {contact},
            cells: [`${name(c.body)} on ${name(c.other)}`, newton(c.push), c.distance < 0 ? mm(-c.distance) : '']})), select, chosen));
    if (n.islands.rows.length > 0)
        parts.push(heading('Islands'), choices(n.islands.rows.map((island, i) => ({hit: {island: i}, order: island.constraints,
            cells: [`island ${i}`, `${island.bodies} bodies`, `${island.constraints} constraints`]})).sort((a, b) => b.order - a.order).slice(0, 50), select, chosen));
    return parts;
}

export function frameFacts({header}, frame) {
    const most = header.cells ? Infinity : 5;  // of stages and pairs: a capture is there to be looked into
    const deepest = frame.contacts.reduce((d, c) => Math.max(d, -c.distance), 0), islands = new Set(frame.bodies.map(b => b.island));
    islands.delete(-1);
    const kept = frame.contacts.length < frame.contactsFound ? `${frame.contactsFound}, the deepest ${frame.contacts.length} drawn` : frame.contactsFound;
    const rows = [['contacts', kept], ['deepest', deepest > 0 ? mm(deepest) : 'none'], ['islands', islands.size]];
    if (header.links) rows.push(['links', frame.links.length]);
    if (frame.cells && !frame.inspection) rows.push(['cells', frame.cells.length < frame.cellsFound ? `${frame.cellsFound}, ${frame.cells.length} drawn` : frame.cellsFound]);
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
