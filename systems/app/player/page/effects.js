// What is drawn besides bodies: threads and staples, drops, smoke, and liquid on surfaces.
import * as three from 'three';
import {linearOf} from './colours.js';

const thickest = 0.003;  // m: as far a film is lifted off its surface along the normal, as in pictures
// Beer-Lambert there and back, as engine/draw/gl_shaders.hpp: absorption of blood at 611, 549 and 464 nm (1/m), and the light that a deep layer sends back
const absorption = [810, 23000, 21000], deepBlood = [0.15, 0.006, 0.007], water = [0.75, 0.8, 0.82];

// Rods and balls of any number: one shape, drawn many times.
class Many {
    constructor(scene, shape) {
        this.scene = scene, this.shape = shape, this.drawn = null;
        this.material = new three.MeshStandardMaterial({roughness: 0.3});
    }
    show(count, place) {
        if (!this.drawn || this.drawn.instanceMatrix.count < count) {
            this.dispose();
            this.drawn = new three.InstancedMesh(this.shape, this.material, Math.max(64, 2 * count));
            this.drawn.frustumCulled = false, this.drawn.castShadow = true;
            this.scene.add(this.drawn);
        }
        const matrix = new three.Matrix4(), colour = new three.Color();
        for (let i = 0; i < count; ++i) {
            place(i, matrix, colour);
            this.drawn.setMatrixAt(i, matrix), this.drawn.setColorAt(i, colour);
        }
        this.drawn.count = count, this.drawn.instanceMatrix.needsUpdate = true;
        if (this.drawn.instanceColor) this.drawn.instanceColor.needsUpdate = true;
    }
    dispose() {
        if (this.drawn) this.scene.remove(this.drawn), this.drawn.dispose();
    }
}

// Optical depth of a Gaussian cloud along a ray at distance b from its middle: extinction / (2 pi s^2) exp(-b^2 / 2 s^2).
const smokeVertex = `attribute float spread, depth; uniform float pixels; varying float middle;
void main() {
    vec4 at = modelViewMatrix * vec4(position, 1.0);
    middle = depth;
    gl_PointSize = min(8.0 * spread * pixels / max(-at.z, 1e-6), 1024.0);
    at.xyz *= max(1.0 + spread / min(at.z, -1e-6), 0.1);  // its near side, so that tissue in its middle does not cut it off
    gl_Position = projectionMatrix * at;
}`;
const smokeFragment = `varying float middle;
void main() {
    vec2 b = 8.0 * (gl_PointCoord - 0.5);
    float light = exp(-middle * exp(-0.5 * dot(b, b)));
    gl_FragColor = vec4(vec3(0.82), 1.0 - light);
}`;

// Liquid lies on its surface as a skin of its own, level where it stands deep.
function filmGeometry(geometry, index, source, {thickness, rise, level, blood}, up) {
    const wet = v => thickness[source[v]] > 0, corners = [];
    for (let i = 0; i < index.length; i += 3)
        if (wet(index[i]) || wet(index[i + 1]) || wet(index[i + 2])) corners.push(index[i], index[i + 1], index[i + 2]);
    const from = geometry.attributes.position.array, normal = geometry.attributes.normal.array;
    const position = new Float32Array(from), lit = new Float32Array(normal), colour = new Float32Array(4 * source.length);
    // a dry corner has the colour of a wet one beside it, and takes no light
    const looks = new Map();
    for (let t = 0; t < corners.length; t += 3) {
        const one = corners.slice(t, t + 3).find(wet);
        for (let k = t; k < t + 3; ++k) if (!looks.has(corners[k])) looks.set(corners[k], wet(corners[k]) ? corners[k] : one);
    }
    for (const [i, look] of looks) {
        const v = source[i], h = thickness[v], l = level[v];
        for (let k = 0; k < 3; ++k) {
            const n = normal[3 * i + k];
            position[3 * i + k] += (1 - l) * Math.min(h, thickest) * n + l * rise[v] * up[k];
            lit[3 * i + k] = (1 - l) * n + l * up[k];
        }
        // one opacity for three colours: that of green, which blood takes most; red light comes back from below as from the deep
        const taken = 1 - Math.exp(-2 * h * blood[v] * absorption[1]), seen = 0.12 * Math.min(1, h / 3e-5);
        const share = Math.min(1, 4 * blood[source[look]]), red = Math.exp(-2 * thickness[source[look]] * blood[source[look]] * absorption[0]);
        deepBlood.forEach((deep, k) => { colour[4 * i + k] = share * (k === 0 ? deep + (0.45 - deep) * red : deep) + (1 - share) * water[k]; });
        colour[4 * i + 3] = Math.max(taken, (1 - share) * seen);
    }
    const made = new three.BufferGeometry();
    made.setIndex(new three.Uint32BufferAttribute(corners, 1));
    made.setAttribute('position', new three.BufferAttribute(position, 3)), made.setAttribute('normal', new three.BufferAttribute(lit, 3));
    made.setAttribute('color', new three.BufferAttribute(colour, 4));
    return made;
}

export class Effects {
    constructor(scene) {
        this.scene = scene, this.films = new Map();
        this.rods = new Many(scene, new three.CylinderGeometry(1, 1, 1, 8, 1, true)), this.balls = new Many(scene, new three.SphereGeometry(1, 12, 8));
        this.smoke = new three.Points(new three.BufferGeometry(), new three.ShaderMaterial({vertexShader: smokeVertex, fragmentShader: smokeFragment,
            uniforms: {pixels: {value: 1}}, transparent: true, depthWrite: false}));
        this.smoke.frustumCulled = false, this.smoke.renderOrder = 5;
        const size = new three.Vector2();
        this.smoke.onBeforeRender = (renderer, _, camera) => {
            this.smoke.material.uniforms.pixels.value = 0.5 * renderer.getDrawingBufferSize(size).y * camera.projectionMatrix.elements[5];
        };
        scene.add(this.smoke);
    }
    // `view`: bodies and surfaces as they are in this frame.
    show(view, {lines, balls, puffs, films}, up, shown) {
        this.showLines(shown ? lines : []);
        this.balls.show(shown ? balls.length : 0, (i, matrix, colour) => {
            const {point, radius} = balls[i];
            matrix.makeScale(radius, radius, radius).setPosition(...point), colour.fromArray(balls[i].colour.map(c => linearOf[c]));
        });
        this.showSmoke(shown ? puffs : []);
        for (const film of this.films.values()) film.removeFromParent(), film.geometry.dispose();
        for (const [body, liquid] of shown ? films : []) this.showFilm(view, body, liquid, new three.Vector3(...up));
    }
    showLines(lines) {
        const rods = lines.flatMap(({radius, colour, points}) => points.slice(1).map((to, i) => ({radius, colour, from: points[i], to})));
        const y = new three.Vector3(0, 1, 0), turn = new three.Quaternion(), from = new three.Vector3(), to = new three.Vector3();
        this.rods.show(rods.length, (i, matrix, colour) => {
            from.fromArray(rods[i].from), to.fromArray(rods[i].to);
            const {radius} = rods[i], along = to.clone().sub(from), length = along.length() || 1e-9;
            turn.setFromUnitVectors(y, along.divideScalar(length));
            matrix.compose(from.add(to).multiplyScalar(0.5), turn, new three.Vector3(radius, length + radius, radius));
            colour.fromArray(rods[i].colour.map(c => linearOf[c]));
        });
    }
    showSmoke(puffs) {
        const {geometry} = this.smoke;
        geometry.dispose();
        this.smoke.geometry = new three.BufferGeometry();
        this.smoke.geometry.setAttribute('position', new three.Float32BufferAttribute(puffs.flatMap(p => p.point), 3));
        this.smoke.geometry.setAttribute('spread', new three.Float32BufferAttribute(puffs.map(p => p.spread), 1));
        this.smoke.geometry.setAttribute('depth', new three.Float32BufferAttribute(puffs.map(p => p.extinction / (2 * Math.PI * p.spread ** 2)), 1));
        this.smoke.visible = puffs.length > 0;
    }
    showFilm(view, body, liquid, up) {
        const mesh = view.bodies[body], {geometry, source, index} = view.surfaces[body];
        if (!this.films.has(body)) {
            const material = new three.MeshStandardMaterial({vertexColors: true, transparent: true, roughness: 0.12, side: three.DoubleSide, depthWrite: false,
                polygonOffset: true, polygonOffsetFactor: -1, polygonOffsetUnits: -1});
            this.films.set(body, new three.Mesh(undefined, material));
        }
        const film = this.films.get(body);
        film.geometry = filmGeometry(geometry, index, source, liquid, up.applyQuaternion(mesh.quaternion.clone().invert()).toArray());
        film.raycast = () => {};  // clicks go to the body
        mesh.add(film);
    }
}
