// Colours of bodies by what the viewer asks for. Linear RGB.
import {Color} from 'three';

export const linearOf = Float32Array.from({length: 256}, (_, i) => new Color(i / 255, 0, 0).convertSRGBToLinear().r);
const coagulated = [0.62, 0.55, 0.44];  // as engine/draw/gl_shaders.hpp
const calm = [0.42, 0.44, 0.47], asleep = [0.13, 0.2, 0.42], still = [0.25, 0.26, 0.28], awake = [0.75, 0.33, 0.12];

// A contact's point: darker the more it pushes; pale blue where it carries nothing.
export function contactColour(scale, contact, limits) {
    return contact.push > 0 ? colourOnScale(scale, 0.25 + 0.6 * contact.push / limits.push) : contact.distance < 0 ? scale[0] : [0.35, 0.5, 0.75];
}

// What the colours mean: css and two ends, or null.
export function legendOf(mode, {depth_colours: scale}, limits) {
    const css = ([r, g, b]) => new Color(r, g, b).getStyle();
    if (mode === 'sleep') return {css: `${css(asleep)} 50%, ${css(awake)} 50%`, low: 'asleep', high: 'awake'};
    if (mode !== 'depth' && mode !== 'cost') return null;
    const high = mode === 'depth' ? `${(1e3 * limits.depth).toPrecision(3)} mm` : `${limits.pair.toPrecision(3)} ms`;
    return {css: scale.map(css).join(','), low: '0', high};
}

export function colourOnScale(scale, share) {
    const at = Math.min(1, Math.max(0, share)) * (scale.length - 1), low = Math.floor(at), high = Math.min(scale.length - 1, low + 1);
    return scale[low].map((x, k) => x + (scale[high][k] - x) * (at - low));
}

// Runs without pictures paint no bodies: these are white, or as grey as what has no material, and told apart by what they are.
const unpainted = [255, 231];
const softs = [[0.45, 0.11, 0.08], [0.55, 0.27, 0.2], [0.5, 0.36, 0.12], [0.35, 0.12, 0.22]], steel = [0.4, 0.43, 0.47], floor = [0.5, 0.45, 0.36];

const isPlain = colours => unpainted.some(grey => colours.every(x => x === grey));

// Linear colours of a mesh's vertices; null if the file gave none.
export function ownColours({colours}) {
    return isPlain(colours) ? null : Float32Array.from(colours, x => linearOf[x]);
}

const lookOf = (header, body) => header.bodies[body].soft ? softs[body % softs.length] : header.bodies[body].still ? floor : steel;

const islandColour = island => new Color().setHSL((island * 0.618034) % 1, 0.6, 0.5).toArray();

// ms of detection that each body had a share in, half of every pair's.
export function costsOfBodies(frame) {
    const cost = new Map();
    for (const {a, b, ms} of frame.pairs)
        for (const body of [a, b]) cost.set(body, (cost.get(body) || 0) + ms / 2);
    return cost;
}

// m, depth by vertex of each body that has a contact.
export function depthsOfVertices(frame) {
    const depths = new Map();
    for (const c of frame.contacts) {
        if (!depths.has(c.body)) depths.set(c.body, new Map());
        const own = depths.get(c.body);
        for (const v of c.vertices) own.set(v, Math.max(own.get(v) ?? -Infinity, -c.distance));
    }
    return depths;
}

export const modes = {
    material: 'material',
    depth: 'contact depth',
    island: 'island',
    sleep: 'asleep or awake',
    cost: 'cost of detection',
};

// A function that fills the colours of one body's drawn vertices; `source` is the vertex of each.
export function painter(mode, recording, frame, limits) {
    const {header, meshes} = recording, scale = header.depth_colours;
    const depths = mode === 'depth' ? depthsOfVertices(frame) : null, costs = mode === 'cost' ? costsOfBodies(frame) : null;
    const flat = (body, state) => {
        if (mode === 'sleep') return header.bodies[body].still ? still : state.asleep ? asleep : awake;
        if (mode === 'island') return state.island < 0 ? still : islandColour(state.island);
        return costs.has(body) ? colourOnScale(scale, costs.get(body) / limits.pair) : calm;
    };
    return (body, source, out) => {
        if (mode === 'material') {
            const {looks} = meshes[header.bodies[body].mesh], plain = lookOf(header, body), burnt = frame.effects && frame.effects.burns.get(body);
            source.forEach((v, i) => {
                const share = burnt ? burnt[v] : 0;
                for (let k = 0; k < 3; ++k) out[3 * i + k] = (1 - share) * (looks ? looks[3 * v + k] : plain[k]) + share * coagulated[k];
            });
            return;
        }
        const own = mode === 'depth' ? depths.get(body) : null, plain = mode === 'depth' ? calm : flat(body, frame.bodies[body]);
        source.forEach((v, i) => {
            const depth = own && own.get(v);
            const colour = depth === undefined || depth === null ? plain : colourOnScale(scale, depth / limits.depth);
            for (let k = 0; k < 3; ++k) out[3 * i + k] = colour[k];
        });
    };
}
