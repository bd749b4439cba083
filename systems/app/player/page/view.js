// The picture: bodies, layers, camera, what a click hits.
import * as three from 'three';
import {OrbitControls} from 'three/addons/controls/OrbitControls.js';
import {pose, softPositions} from './data.js';
import {Surface} from './surface.js';
import {Effects} from './effects.js';
import {contactColour, ownColours, painter} from './colours.js';

const clickRadius = 7;       // pixels, around a contact
const mostWithShadows = 500;  // bodies: shadows draw each once more

// Box of what the camera should show: what forces move, else what moves, else everything.
function boxToFit(view) {
    const {bodies} = view.recording.header;
    for (const wanted of [b => b.fitted, b => !b.still, () => true]) {
        const box = new three.Box3();
        view.bodies.forEach((mesh, i) => { if (wanted(bodies[i]) && mesh.visible) box.expandByObject(mesh, true); });
        if (!box.isEmpty()) return box;
    }
    return new three.Box3(new three.Vector3(-1, -1, -1), new three.Vector3(1, 1, 1));
}

// Axes as systems/output/render.cpp has them: azimuth counts about up, from +x where up is +z.
function orbitDirection({up, azimuth, elevation}) {
    const sky = new three.Vector3(...up).normalize();
    const east = Math.abs(sky.x) < 0.9 ? new three.Vector3(1, 0, 0) : new three.Vector3(0, 1, 0);
    east.addScaledVector(sky, -east.dot(sky)).normalize();
    const north = sky.clone().cross(east);
    return east.multiplyScalar(Math.cos(elevation) * Math.cos(azimuth))
        .addScaledVector(north, Math.cos(elevation) * Math.sin(azimuth))
        .addScaledVector(sky, Math.sin(elevation));
}

// A white disc or ring: points are squares without it.
function disc(isRing) {
    const canvas = Object.assign(document.createElement('canvas'), {width: 32, height: 32}), pen = canvas.getContext('2d');
    pen.fillStyle = '#fff', pen.beginPath(), pen.arc(16, 16, isRing ? 12 : 14, 0, 7);
    pen.lineWidth = 6, pen.strokeStyle = '#fff', isRing ? pen.stroke() : pen.fill();
    return canvas;
}

// Lines or points whose number changes from frame to frame, drawn over the bodies.
function overlay(Kind, material) {
    const drawn = new Kind(new three.BufferGeometry(), material);
    drawn.frustumCulled = false, drawn.renderOrder = 10;
    return drawn;
}

function setOverlay(drawn, position, colour) {
    drawn.geometry.dispose();
    drawn.geometry = new three.BufferGeometry();
    drawn.geometry.setAttribute('position', new three.Float32BufferAttribute(position, 3));
    if (colour) drawn.geometry.setAttribute('color', new three.Float32BufferAttribute(colour, 3));
}

export class View {
    constructor(canvas, recording) {
        this.recording = recording, this.canvas = canvas, this.frame = 0, this.selected = null;
        this.layers = {contacts: true, normals: false, forces: false, tools: true, links: true, effects: true, cells: false, boxes: false, pairs: false, wireframe: false, seeThrough: false};
        this.follows = false;  // the scene's camera, not the pointer
        this.mode = 'material', this.limits = recording.header.limits;
        this.renderer = new three.WebGLRenderer({canvas, antialias: true});
        this.renderer.setPixelRatio(Math.min(2, devicePixelRatio));
        this.renderer.shadowMap.enabled = recording.header.bodies.length <= mostWithShadows;
        this.scene = new three.Scene();
        this.scene.background = new three.Color(0xe9edf2);
        this.camera = new three.PerspectiveCamera();
        this.makeBodies();
        this.makeLayers();
        this.effects = recording.header.effects ? new Effects(this.scene) : null;
        this.show(0);
        this.placeCamera();
        this.makeLights();
    }
    makeBodies() {
        const {header, meshes, frames} = this.recording;
        for (const m of meshes) m.looks = ownColours(m);
        this.meshSurface = meshes.map(m => m.position && new Surface(m.position, m.triangles));
        this.surfaces = header.bodies.map((body, i) => body.soft
            ? new Surface(softPositions(this.recording, i, 0, new Float32Array(frames[0].bodies[i].at.length)), meshes[body.mesh].triangles)
            : this.meshSurface[body.mesh]);
        this.bodies = header.bodies.map((body, i) => {
            const {opacity} = meshes[body.mesh];
            const material = new three.MeshStandardMaterial({vertexColors: true, roughness: 0.5, side: three.DoubleSide});
            const mesh = new three.Mesh(this.surfaces[i].coloured(), material);
            material.userData.opacity = opacity;
            mesh.castShadow = mesh.receiveShadow = opacity > 0.9;
            mesh.userData.body = i;
            this.scene.add(mesh);
            return mesh;
        });
        this.drawn = header.bodies.map(() => null);  // coordinates that the geometry holds
    }
    makeLayers() {
        const over = {depthTest: false, transparent: true}, dot = new three.CanvasTexture(disc(false)), ring = new three.CanvasTexture(disc(true));
        this.points = overlay(three.Points, new three.PointsMaterial({size: 5 * devicePixelRatio, sizeAttenuation: false, vertexColors: true, map: dot, ...over}));
        this.normals = overlay(three.LineSegments, new three.LineBasicMaterial({color: 0x0b5cad, opacity: 0.8, ...over}));
        this.forces = overlay(three.LineSegments, new three.LineBasicMaterial({color: 0xb3123f, ...over}));
        this.cells = overlay(three.LineSegments, new three.LineBasicMaterial({color: 0x2a7d4f, opacity: 0.35, ...over}));
        this.boxes = overlay(three.LineSegments, new three.LineBasicMaterial({vertexColors: true, ...over, opacity: 0.6}));
        this.pairs = overlay(three.LineSegments, new three.LineBasicMaterial({vertexColors: true, ...over}));
        this.mark = overlay(three.Points, new three.PointsMaterial({size: 18 * devicePixelRatio, sizeAttenuation: false, color: 0x111827, map: ring, ...over}));
        this.mark.renderOrder = 11;
        this.links = overlay(three.LineSegments, new three.LineBasicMaterial({color: 0x6b2fa0, ...over}));
        this.hand = overlay(three.LineSegments, new three.LineBasicMaterial({vertexColors: true, ...over}));
        this.tips = overlay(three.Points, new three.PointsMaterial({size: 9 * devicePixelRatio, sizeAttenuation: false, vertexColors: true, map: dot, ...over}));
        this.scene.add(this.mark, this.points, this.normals, this.forces, this.links, this.cells, this.boxes, this.pairs, this.hand, this.tips);
    }
    placeCamera() {
        const {camera} = this.recording.header, box = boxToFit(this), size = box.getSize(new three.Vector3()).length();
        this.size = size;
        this.camera.up.set(...camera.up).normalize();  // before OrbitControls, which takes its axes from it
        this.camera.fov = camera.field_of_view * 180 / Math.PI;
        const target = box.getCenter(new three.Vector3());
        if (!camera.orbit) {
            this.camera.position.set(...camera.position), target.set(...camera.target);
        } else {
            if (camera.distance > 0) target.set(...camera.target);
            const distance = camera.distance > 0 ? camera.distance : 0.55 * size / Math.tan(camera.field_of_view / 2);
            this.camera.position.copy(target).addScaledVector(orbitDirection(camera), distance);
        }
        // near and far for everything that is there, seen from wherever one may go
        const all = new three.Box3().setFromObject(this.scene), reach = all.isEmpty() ? size : all.getSize(new three.Vector3()).length();
        this.camera.near = 0.002 * size, this.camera.far = 20 * Math.max(size, Math.min(reach, 50 * size));
        this.controls = new OrbitControls(this.camera, this.canvas);
        this.controls.target.copy(target), this.controls.update(), this.controls.saveState();
        this.controls.addEventListener('change', () => this.draw());
    }
    makeLights() {
        const up = this.camera.up.clone(), target = this.controls.target;
        const sky = new three.HemisphereLight(0xffffff, 0x9a8f88, 1.1);
        sky.position.copy(up), this.scene.add(sky);
        const head = new three.DirectionalLight(0xffffff, 0.6), lamp = new three.DirectionalLight(0xfff4e6, 1.5);
        this.camera.add(head), this.scene.add(this.camera);
        const side = this.camera.position.clone().sub(target).normalize().cross(up);
        lamp.position.copy(target).addScaledVector(up, 2 * this.size).addScaledVector(side, this.size * 0.8);
        lamp.target.position.copy(target);
        lamp.castShadow = true, lamp.shadow.mapSize.set(1024, 1024), lamp.shadow.normalBias = 0.004 * this.size, lamp.shadow.bias = -1e-4;
        const reach = 0.9 * this.size;
        Object.assign(lamp.shadow.camera, {left: -reach, right: reach, bottom: -reach, top: reach, near: 0.2 * this.size, far: 5 * this.size});
        this.scene.add(lamp, lamp.target);
    }
    resize() {
        const {clientWidth: width, clientHeight: height} = this.canvas;
        this.renderer.setSize(width, height, false);
        this.camera.aspect = width / height, this.camera.updateProjectionMatrix();
        this.draw();
    }
    show(frame) {
        this.frame = frame;
        const {header, frames} = this.recording, now = frames[frame];
        header.bodies.forEach((body, i) => {
            this.bodies[i].visible = !now.bodies[i].away;
            body.soft ? this.moveSoft(i, now) : this.moveRigid(i);
        });
        this.paint();
        this.updateLayers(now);
        if (this.follows) this.placeScope();
        this.draw();
    }
    moveSoft(i, now) {
        const {at} = now.bodies[i], torn = now.surfaces.get(i);
        const triangles = torn || this.recording.meshes[this.recording.header.bodies[i].mesh].triangles;
        if (this.drawn[i] === at && this.surfaces[i].triangles === triangles) return;
        this.buffer = this.buffer && this.buffer.length >= at.length ? this.buffer : new Float32Array(at.length);
        const position = softPositions(this.recording, i, this.frame, this.buffer.subarray(0, at.length));
        if (this.surfaces[i].triangles !== triangles) {
            this.surfaces[i] = new Surface(position, triangles);
            this.bodies[i].geometry.dispose();
            this.bodies[i].geometry = this.surfaces[i].coloured();
            if (this.bodies[i].userData.wire) this.bodies[i].userData.wire.geometry = this.bodies[i].geometry;
        } else {
            this.surfaces[i].move(position);
            this.bodies[i].geometry.boundingSphere = this.surfaces[i].geometry.boundingSphere;
            this.bodies[i].geometry.boundingBox = null;
        }
        this.drawn[i] = at;
    }
    moveRigid(i) {
        const {position, turn} = pose(this.recording, i, this.frame);
        this.bodies[i].position.set(...position);
        this.bodies[i].quaternion.set(...turn).normalize();
    }
    paint() {
        const fill = painter(this.mode, this.recording, this.recording.frames[this.frame], this.limits);
        this.bodies.forEach((mesh, i) => {
            const {color} = mesh.geometry.attributes;
            fill(i, this.surfaces[i].source, color.array);
            color.needsUpdate = true;
            const opacity = this.layers.seeThrough ? Math.min(0.3, mesh.material.userData.opacity) : mesh.material.userData.opacity;
            Object.assign(mesh.material, {opacity, transparent: opacity < 1, depthWrite: opacity >= 1});
            mesh.material.emissive.setHex(this.selected && this.selected.body === i ? 0x14304d : 0);
            this.setWire(mesh);
        });
    }
    setWire(mesh) {
        if (this.layers.wireframe && !mesh.userData.wire) {
            const material = new three.MeshBasicMaterial({color: 0x17212f, wireframe: true, transparent: true, opacity: 0.35});
            mesh.add(mesh.userData.wire = new three.Mesh(mesh.geometry, material));
            mesh.material.polygonOffset = true, mesh.material.polygonOffsetFactor = mesh.material.polygonOffsetUnits = 1;
        }
        if (mesh.userData.wire) mesh.userData.wire.visible = this.layers.wireframe;
    }
    updateLayers(now) {
        const size = this.size || boxToFit(this).getSize(new three.Vector3()).length(), {limits} = this;
        const scale = this.recording.header.depth_colours, point = [], colour = [], normal = [], force = [];
        for (const c of now.contacts) {
            const to = (length, sign = 1) => c.point.map((x, k) => x + sign * c.normal[k] * length);
            point.push(...c.point), normal.push(...c.point, ...to(0.03 * size));
            colour.push(...contactColour(scale, c, limits));
            if (c.push > 0) force.push(...c.point, ...to(0.2 * size * c.push / limits.push));
        }
        setOverlay(this.points, point, colour), setOverlay(this.normals, normal), setOverlay(this.forces, force);
        this.showTools(now, size);
        setOverlay(this.links, now.links.flat(2));
        if (now.cells) setOverlay(this.cells, now.cells.flatMap(cell => cellEdges(cell, now)));
        if (now.effects) this.effects.show(this, now.effects, this.recording.header.effects.up, this.layers.effects);
        this.showPairs(now);
        this.markContact();
        const {layers} = this;
        this.points.visible = layers.contacts, this.normals.visible = layers.normals, this.forces.visible = layers.forces;
        this.boxes.visible = layers.boxes || this.chosenBodies(now).length > 0, this.pairs.visible = layers.pairs;
        this.cells.visible = layers.cells, this.links.visible = layers.links, this.hand.visible = this.tips.visible = layers.tools;
    }
    // Marks the chosen contact, or those of the chosen pair.
    markContact() {
        const {contacts, inspection} = this.recording.frames[this.frame], {contact, pair} = this.selected || {};
        const of = inspection && pair !== undefined ? inspection.pairs.rows[pair] : null;
        const marked = of ? contacts.filter(c => (c.body === of.a && c.other === of.b) || (c.body === of.b && c.other === of.a)) : contacts[contact] ? [contacts[contact]] : [];
        this.mark.material.size = (marked.length > 1 ? 8 : 18) * devicePixelRatio;
        setOverlay(this.mark, marked.flatMap(c => c.point));
    }
    // Of a chosen pair or island.
    chosenBodies(now) {
        const {pair, island} = this.selected || {};
        if (now.inspection && pair !== undefined) return [now.inspection.pairs.rows[pair].a, now.inspection.pairs.rows[pair].b];
        return island !== undefined ? now.bodies.flatMap((b, i) => b.island === island ? [i] : []) : [];
    }
    // Boxes of all bodies or of the chosen ones; candidate pairs from middle to middle: red where they overlap, brown where they have contacts.
    showPairs(now) {
        if (!now.inspection) return;
        const {boxes, pairs} = now.inspection, chosen = new Set(this.chosenBodies(now)), edge = [], edgeColour = [], line = [], lineColour = [];
        boxes.rows.forEach(([low, high], body) => {
            if (!this.layers.boxes && !chosen.has(body)) return;
            const edges = boxEdges(low, high), colour = chosen.has(body) ? [0.7, 0.2, 0] : [0.05, 0.2, 0.45];
            edge.push(...edges);
            for (let i = 0; i < edges.length; i += 3) edgeColour.push(...colour);
        });
        const middle = body => boxes.rows[body][0].map((x, k) => (x + boxes.rows[body][1][k]) / 2);
        for (const p of pairs.rows) {
            if (p.a >= boxes.rows.length || p.b >= boxes.rows.length) continue;
            const colour = p.depth > 0 ? [0.75, 0.05, 0.05] : p.contacts > 0 ? [0.5, 0.3, 0] : [0.35, 0.4, 0.5];
            line.push(...middle(p.a), ...middle(p.b)), lineColour.push(...colour, ...colour);
        }
        setOverlay(this.boxes, edge, edgeColour), setOverlay(this.pairs, line, lineColour);
        this.boxes.visible = this.layers.boxes || chosen.size > 0;
    }
    showTools(now, size) {
        const line = [], lineColour = [], tip = [], tipColour = [], green = [0.02, 0.5, 0.15], red = [0.7, 0.05, 0.05];
        for (const t of now.tools) {
            tip.push(...t.device, ...t.proxy), tipColour.push(...green, ...red);
            line.push(...t.device, ...t.proxy, ...t.device, ...t.force.map((f, k) => t.device[k] + 0.25 * size * f / this.limits.hand));
            lineColour.push(...green, ...green, ...red, ...red);
        }
        setOverlay(this.tips, tip, tipColour), setOverlay(this.hand, line, lineColour);
    }
    draw() {
        if (this.waiting) return;
        this.waiting = true;
        requestAnimationFrame(() => { this.waiting = false, this.renderer.render(this.scene, this.camera); });
    }
    home() { this.controls.reset(); }
    // The scene's camera: a laparoscope as it is held in this frame, with its round picture, or the scene's viewpoint. False: the pointer
    // turns the camera from where it is.
    follow(on) {
        const {camera} = this.recording.header, scope = on && !camera.orbit;
        this.follows = scope, this.controls.enabled = !scope;
        this.canvas.style.clipPath = scope ? 'circle(closest-side)' : '';
        if (camera.held) this.bodies[camera.held.body].visible = !scope && !this.recording.frames[this.frame].bodies[camera.held.body].away;
        if (scope) this.placeScope();
        else if (on) this.home();
        else {
            const ahead = this.camera.getWorldDirection(new three.Vector3()), away = this.camera.position.distanceTo(this.controls.target);
            this.camera.up.set(...camera.up).normalize();
            this.controls.target.copy(this.camera.position).addScaledVector(ahead, away);
            this.controls.update();
        }
        this.draw();
    }
    // As placed_camera of systems/output/render.cpp.
    placeScope() {
        const {camera} = this.recording.header, {held} = camera;
        if (!held) {
            this.camera.up.set(...camera.up), this.camera.position.set(...camera.position);
            return this.camera.lookAt(...camera.target);
        }
        this.bodies[held.body].visible = false;
        const {position, turn} = pose(this.recording, held.body, this.frame), rotation = new three.Quaternion(...turn).normalize();
        const turned = v => new three.Vector3(...v).applyQuaternion(rotation), along = turned(held.shaft).normalize(), mark = turned(held.mark);
        const aboutShaft = (up, angle) => {
            const top = up.clone().addScaledVector(along, -up.dot(along)).normalize();
            return top.clone().multiplyScalar(Math.cos(angle)).addScaledVector(along.clone().cross(top), Math.sin(angle));
        };
        const looks = along.clone().multiplyScalar(Math.cos(held.optic)).addScaledVector(aboutShaft(mark, held.optic_roll), Math.sin(held.optic));
        const top = aboutShaft(held.level ? new three.Vector3(...camera.up) : mark, held.roll);
        this.camera.position.copy(turned(held.position)).add(new three.Vector3(...position));
        this.camera.up.copy(top.addScaledVector(looks, -top.dot(looks)).normalize());
        this.camera.lookAt(this.camera.position.clone().addScaledVector(looks, held.light));
    }
    // A browser has room for a few views.
    dispose() { this.renderer.dispose(), this.renderer.forceContextLoss(); }
    // The point under a place of the canvas that is as far away as `point`.
    onPlane(x, y, point) {
        const {clientWidth: width, clientHeight: height} = this.canvas, at = new three.Vector3(...point).project(this.camera);
        return new three.Vector3(2 * x / width - 1, 1 - 2 * y / height, at.z).unproject(this.camera).toArray();
    }
    // `point` moved away from the camera, m.
    deeper(point, by) { return new three.Vector3(...point).addScaledVector(this.camera.getWorldDirection(new three.Vector3()), by).toArray(); }
    // The contact or body under a place of the canvas, in pixels; null where there is none.
    pick(x, y) {
        const {clientWidth: width, clientHeight: height} = this.canvas, {contacts} = this.recording.frames[this.frame];
        let nearest = null, least = clickRadius;
        if (this.layers.contacts) {
            contacts.forEach((c, i) => {
                const p = new three.Vector3(...c.point).project(this.camera);
                const away = Math.hypot((p.x + 1) / 2 * width - x, (1 - p.y) / 2 * height - y);
                if (p.z < 1 && away < least) least = away, nearest = {contact: i};
            });
        }
        if (nearest) return nearest;
        return this.pickBody(x, y);
    }
    // The body there, and the point of its surface.
    pickBody(x, y) {
        const {clientWidth: width, clientHeight: height} = this.canvas;
        const ray = new three.Raycaster();
        ray.setFromCamera(new three.Vector2(2 * x / width - 1, 1 - 2 * y / height), this.camera);
        const hits = ray.intersectObjects(this.bodies.filter(b => b.visible), false);
        return hits.length > 0 ? {body: hits[0].object.userData.body, point: hits[0].point.toArray()} : null;
    }
}

function boxEdges(low, high) {
    const edges = [], corner = bits => [0, 1, 2].map(k => (bits >> k & 1 ? high : low)[k]);
    for (let a = 0; a < 8; ++a)
        for (const bit of [1, 2, 4]) if (!(a & bit)) edges.push(...corner(a), ...corner(a | bit));
    return edges;
}

function cellEdges(cell, {cellSize, cellOrigin}) {
    const edges = [], corner = bits => [0, 1, 2].map(k => cellOrigin[k] + cellSize * (cell[k] + (bits >> k & 1)));
    for (let a = 0; a < 8; ++a)
        for (const bit of [1, 2, 4]) if (!(a & bit)) edges.push(...corner(a), ...corner(a | bit));
    return edges;
}
