// Reads what PlayerCoder wrote (systems/app/player/player_coder.cpp). Lengths in m, forces in N.

class Reader {
    constructor(bytes) {
        this.bytes = bytes, this.at = 0;
        this.view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    }
    number() {
        let value = 0, scale = 1;
        for (;; scale *= 128) {
            const byte = this.bytes[this.at++];
            value += (byte & 127) * scale;
            if (byte < 128) return value;
        }
    }
    signed() {
        const value = this.number();
        return value % 2 ? -(value + 1) / 2 : value / 2;
    }
    float() { return this.view.getFloat32((this.at += 4) - 4, true); }
    double() { return this.view.getFloat64((this.at += 8) - 8, true); }
    vector() { return [this.float(), this.float(), this.float()]; }
    text(length) { return new TextDecoder().decode(this.bytes.subarray(this.at, this.at += length)); }
    times(count, read) { return Array.from({length: count}, read); }
}

function readTriangles(r) {
    const corners = new Uint32Array(3 * r.number());
    let before = 0;
    for (let i = 0; i < corners.length; ++i) corners[i] = before += r.signed();
    return corners;
}

function readMesh(r) {
    const count = r.number(), hasShape = r.number() === 1, step = r.double(), opacity = r.float();
    const position = hasShape ? new Float32Array(3 * count) : null, before = [0, 0, 0];
    if (hasShape)
        for (let i = 0; i < 3 * count; ++i) position[i] = (before[i % 3] += r.signed()) * step;
    const triangles = readTriangles(r);
    const colours = r.bytes.slice(r.at, r.at += 3 * count);  // sRGB
    return {count, position, triangles, colours, opacity};
}

const State = {away: 0, awake: 1, asleep: 2, island: 3};

// A body that did not move shares its coordinates with the frame before.
function readMoves(r, header, meshes, before) {
    return header.bodies.map((body, b) => {
        const word = r.number(), last = before && before[b];
        const state = Math.floor(word / 2), own = {away: state === State.away, asleep: state === State.asleep,
                                                  island: state >= State.island ? state - State.island : -1};
        const count = body.soft ? 3 * meshes[body.mesh].count : 7;
        if (word % 2 === 0) return {...own, at: last ? last.at : new Int32Array(count)};
        const at = last ? last.at.slice() : new Int32Array(count);
        for (let i = 0; i < count; ++i) at[i] += r.signed();
        return {...own, at};
    });
}

// Column by column; each number is a step from the one above.
function readContacts(r, header) {
    const count = r.number();
    const column = () => { let value = 0; return r.times(count, () => value += r.signed()); };
    const body = column(), other = column(), first = column(), second = column(), third = column();
    const point = [column(), column(), column()], normal = [column(), column(), column()];
    const distance = column(), constrained = column(), push = column(), friction = column();
    return body.map((_, i) => ({
        body: body[i], other: other[i], vertices: [first[i], first[i] + second[i], ...(third[i] > 0 ? [third[i] - 1] : [])],
        point: point.map(x => x[i] * header.point_step), normal: normal.map(x => x[i] * header.normal_step),
        distance: distance[i] * header.depth_step, constrained: constrained[i] === 1,
        push: push[i] * header.force_step, friction: friction[i] * header.force_step,
    }));
}

// `ms`: of its pass. What a pass found is read when it is looked at, and kept for one frame: a long run has a million contacts.
class Frame {
    constructor(time, pass, ms) { Object.assign(this, {time, pass, ms}); }
    get found() {
        if (Frame.newest !== this) Frame.newest = this, Frame.kept = this.read();
        return Frame.kept;
    }
}
for (const name of ['stages', 'pairs', 'contactsFound', 'contacts', 'tools', 'links', 'effects', 'cellsFound', 'cellSize', 'cellOrigin', 'cells', 'inspection'])
    Object.defineProperty(Frame.prototype, name, {get() { return this.found[name]; }});

function readFrame(r, header, meshes, before) {
    const frame = new Frame(r.double(), r.number(), r.number() * 1e-3);
    frame.bodies = readMoves(r, header, meshes, before && before.bodies);
    frame.surfaces = new Map(before ? before.surfaces : []);  // of torn bodies, instead of their meshes'
    for (let body; (body = r.number()) > 0;) frame.surfaces.set(body - 1, readTriangles(r));
    return frame;
}

// What the stages of a pass left for each other. Of lists the first rows are there.
function readInspection(r) {
    const list = read => { const found = r.number(), rows = r.times(r.number(), read); return {found, rows}; };
    return {
        boxPairs: r.number(), trianglePairs: r.number(), nearVertices: r.number(), constraints: r.number(), loaded: r.number(),
        boxes: list(() => [r.vector(), r.vector()]),
        pairs: list(() => ({a: r.number(), b: r.number(), trianglePairs: r.number(), nearVertices: r.number(), contacts: r.number(),
                            constraints: r.number(), depth: r.float(), force: r.float()})),
        islands: list(() => ({bodies: r.number(), constraints: r.number()})),
    };
}

// One number a vertex; of zeros one, and how many more follow.
function readSparse(r) {
    const values = new Uint32Array(r.number());
    for (let v = 0; v < values.length; ++v)
        if ((values[v] = r.number()) === 0) v += r.number();
    return values;
}

// What pictures show besides bodies. Of wet bodies per vertex: thickness and height of the liquid (m), how level it stands and
// its share of blood (0 to 1); of burnt ones the share of tissue that has coagulated.
function readEffects(r, header) {
    const {film_step: filmStep, rise_step: riseStep} = header.effects, at = [0, 0, 0];
    const place = () => at.map((_, k) => (at[k] += r.signed()) * header.point_step), colour = () => [...r.bytes.subarray(r.at, r.at += 3)];
    const lines = r.times(r.number(), () => { const count = r.number(); return {radius: r.float(), colour: colour(), points: r.times(count, place)}; });
    const balls = r.times(r.number(), () => ({point: place(), radius: r.float(), colour: colour()}));
    const puffs = r.times(r.number(), () => ({point: place(), spread: r.float(), extinction: r.float()}));
    const films = new Map(r.times(r.number(), () => {
        const body = r.number(), steps = readSparse(r), column = read => { const out = new Float32Array(steps.length); steps.forEach((s, v) => { if (s > 0) out[v] = read(); }); return out; };
        const rise = column(() => r.signed() * riseStep), level = column(() => r.bytes[r.at++] / 255), blood = column(() => r.bytes[r.at++] / 255);
        return [body, {thickness: Float32Array.from(steps, s => s * filmStep), rise, level, blood}];
    }));
    const burns = new Map(r.times(r.number(), () => [r.number(), Float32Array.from(readSparse(r), s => s / 255)]));
    return {lines, balls, puffs, films, burns};
}

function readFindings(r, header) {
    const found = {};
    found.stages = r.times(r.number(), () => r.number() * 1e-3);  // ms
    found.pairs = r.times(r.number(), () => ({a: r.number(), b: r.number(), vertices: r.number(), ms: r.number() * 1e-3}));
    found.contactsFound = r.number();
    found.contacts = readContacts(r, header);
    found.tools = r.times(r.number(), () => ({device: r.vector(), proxy: r.vector(), force: r.vector()}));
    found.links = r.times(r.number(), () => [r.vector(), r.vector()]);
    if (header.effects) found.effects = readEffects(r, header);
    if (!header.cells) return found;
    found.cellsFound = r.number();
    const count = r.number();
    found.cellSize = r.float(), found.cellOrigin = r.vector();
    found.cells = r.times(count, () => [r.number(), r.number(), r.number()]);
    found.inspection = readInspection(r);
    return found;
}

// What a live view sends after its start: one frame as steps from the one before, and its findings.
export function readLiveFrame(bytes, {header, meshes}, before) {
    const r = new Reader(bytes), frame = readFrame(r, header, meshes, before);
    r.number();  // bytes of the findings
    const rest = bytes.subarray(r.at);
    frame.read = () => readFindings(new Reader(rest), header);
    return frame;
}

export function readRecording(bytes) {
    const r = new Reader(bytes);
    const header = JSON.parse(r.text(r.number()));
    const meshes = r.times(header.meshes, () => readMesh(r));
    const frames = [];
    for (let i = 0; i < header.frames; ++i) frames.push(readFrame(r, header, meshes, frames[i - 1]));
    for (const frame of frames) {
        const length = r.number();
        frame.read = () => readFindings(new Reader(bytes.subarray(frame.begin, frame.begin + length)), header);
        frame.begin = r.at, r.at += length;
    }
    return {header, meshes, frames};
}

// World positions (from the recording's origin) of a soft body's vertices in a frame.
export function softPositions(recording, body, frame, out) {
    const {at} = recording.frames[frame].bodies[body], step = recording.header.bodies[body].step;
    for (let i = 0; i < at.length; ++i) out[i] = at[i] * step;
    return out;
}

// Position and quaternion (x, y, z, w) of a rigid body.
export function pose(recording, body, frame) {
    const {at} = recording.frames[frame].bodies[body], {bodies, turn_step: turn} = recording.header, step = bodies[body].step;
    return {position: [at[0] * step, at[1] * step, at[2] * step], turn: [at[4] * turn, at[5] * turn, at[6] * turn, at[3] * turn]};
}
