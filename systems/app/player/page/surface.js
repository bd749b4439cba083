// Surfaces as three.js draws them: vertices are doubled along creases, so that edges look sharp and tissue smooth.
import {BufferAttribute, BufferGeometry} from 'three';

const creaseCosine = 0.766;  // 40 degrees

function faceNormals(position, triangles) {
    const normal = new Float32Array(triangles.length);
    for (let t = 0; t < triangles.length; t += 3) {
        const a = 3 * triangles[t], b = 3 * triangles[t + 1], c = 3 * triangles[t + 2];
        const u = [0, 1, 2].map(k => position[b + k] - position[a + k]), v = [0, 1, 2].map(k => position[c + k] - position[a + k]);
        const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        const length = Math.hypot(...n) || 1;
        for (let k = 0; k < 3; ++k) normal[t + k] = n[k] / length;
    }
    return normal;
}

// The corners of every vertex, one vertex after another.
function cornersOfVertices(triangles, count) {
    const first = new Uint32Array(count + 1), corner = new Uint32Array(triangles.length);
    for (const v of triangles) ++first[v + 1];
    for (let v = 0; v < count; ++v) first[v + 1] += first[v];
    const next = first.slice();
    for (let i = 0; i < triangles.length; ++i) corner[next[triangles[i]]++] = i;
    return {first, corner};
}

// Groups the corners of each vertex whose triangles meet at an edge of it without a crease: one drawn vertex a group.
// Returns the vertex of every drawn one, and the drawn vertex of every corner.
export function splitAtCreases(position, triangles) {
    const count = position.length / 3, normal = faceNormals(position, triangles);
    const {first, corner} = cornersOfVertices(triangles, count);
    const index = new Uint32Array(triangles.length).fill(0xffffffff), source = [];
    const smooth = (i, j) => {
        const a = i - i % 3, b = j - j % 3;
        return normal[a] * normal[b] + normal[a + 1] * normal[b + 1] + normal[a + 2] * normal[b + 2] >= creaseCosine;
    };
    const others = i => [triangles[i - i % 3 + (i + 1) % 3], triangles[i - i % 3 + (i + 2) % 3]];
    for (let v = 0; v < count; ++v) {
        for (let at = first[v]; at < first[v + 1]; ++at) {
            if (index[corner[at]] !== 0xffffffff) continue;
            const open = [corner[at]];
            index[corner[at]] = source.length;
            while (open.length > 0) {
                const i = open.pop(), ends = others(i);
                for (let next = first[v]; next < first[v + 1]; ++next) {
                    const j = corner[next];
                    if (index[j] !== 0xffffffff || !smooth(i, j) || !others(j).some(end => ends.includes(end))) continue;
                    index[j] = source.length;
                    open.push(j);
                }
            }
            source.push(v);
        }
    }
    return {source: Uint32Array.from(source), index};
}

export class Surface {
    constructor(position, triangles) {
        this.triangles = triangles;
        Object.assign(this, splitAtCreases(position, triangles));
        this.geometry = new BufferGeometry();
        this.geometry.setIndex(new BufferAttribute(this.index, 1));
        for (const name of ['position', 'normal']) this.geometry.setAttribute(name, new BufferAttribute(new Float32Array(3 * this.source.length), 3));
        this.move(position);
    }
    move(position) {
        const {array} = this.geometry.attributes.position;
        this.source.forEach((v, i) => { for (let k = 0; k < 3; ++k) array[3 * i + k] = position[3 * v + k]; });
        this.geometry.attributes.position.needsUpdate = true;
        this.geometry.computeVertexNormals();
        this.geometry.computeBoundingSphere();
    }
    // A geometry with the same surface and colours of its own.
    coloured() {
        const own = new BufferGeometry();
        own.setIndex(this.geometry.index);
        for (const name of ['position', 'normal']) own.setAttribute(name, this.geometry.attributes[name]);
        own.setAttribute('color', new BufferAttribute(new Float32Array(3 * this.source.length), 3));
        own.boundingSphere = this.geometry.boundingSphere;
        return own;
    }
}
