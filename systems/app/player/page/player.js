// The player: bodies in 3D, buttons, numbers. Other parts of the page go to a time by the event `trocar-time`
// on the document (detail: s), and hear by `trocar-shown` which time is on show.
import {legendOf, modes} from './colours.js';
import {View} from './view.js';
import {bodyFacts, contactFacts, frameFacts, islandFacts, nameOfPass, pairFacts, stageFacts} from './facts.js';

export const style = `
#player{display:grid;grid-template-columns:minmax(0,1fr) 300px;background:#fff;border:1px solid #e3e6ea;border-radius:8px;overflow:hidden;outline-offset:2px}
#player canvas{width:100%;height:min(62vh,640px);min-height:320px;display:block;touch-action:none;cursor:grab}
#player .bar{grid-column:1/-1;display:flex;flex-wrap:wrap;gap:6px 12px;align-items:center;padding:8px 12px;border-top:1px solid #e3e6ea;font-size:13.5px}
#player .bar input[type=range]{flex:1 1 240px}
#player button,#player select,#player input:not([type]){font:inherit;padding:3px 9px;border:1px solid #c9ced6;border-radius:5px;background:#f7f8fa;cursor:pointer}
#player .play{min-width:64px}
#player output{font-variant-numeric:tabular-nums;min-width:150px}
#player .facts3d{box-sizing:border-box;padding:10px 12px;border-left:1px solid #e3e6ea;font-size:13px;overflow:auto;max-height:min(62vh,640px)}
#player .facts3d h3{font-size:13.5px;margin:10px 0 2px}#player .facts3d h3:first-child{margin-top:0}
#player .facts3d table{font-size:12.5px;width:100%}#player .facts3d td{padding:1px 6px 1px 0}
#player .legend i{display:inline-block;width:110px;height:10px;margin:0 6px;border-radius:3px}
#player .choices tr{cursor:pointer}#player .choices tr:hover,#player .choices tr:focus{background:#eef2f7}#player .choices .chosen{background:#dbe7f5}
#player .hint{color:#667085}
@media(max-width:820px){#player{grid-template-columns:1fr}#player .facts3d{border-left:0;border-top:1px solid #e3e6ea;max-height:240px}}`;

const layerNames = {contacts: 'contacts', normals: 'normals', forces: 'contact forces', tools: 'tools and their forces', links: 'links', effects: 'threads and fluids', wireframe: 'wireframe',
                    seeThrough: 'see-through', cells: 'cells of the grid', boxes: 'boxes of bodies', pairs: 'candidate pairs'};

export function element(name, properties = {}, ...children) {
    const made = Object.assign(document.createElement(name), properties);
    made.append(...children);
    return made;
}

export class Player {
    constructor(host, recording) {
        this.recording = recording, this.frames = recording.frames, this.at = 0, this.playing = false, this.speed = 1;
        this.canvas = element('canvas');
        this.facts = element('div', {className: 'facts3d'});
        this.bar = this.makeBar(), this.layers = this.makeLayers();
        host.textContent = '';
        host.tabIndex = 0;
        host.setAttribute('aria-label', '3D player: space plays, arrow keys step');
        host.append(element('style', {textContent: style}), this.canvas, this.facts, this.bar, this.layers);
        this.view = new View(this.canvas, recording);
        new ResizeObserver(() => this.view.resize()).observe(this.canvas);
        this.view.resize();
        this.listen(host);
        this.show(0);
    }
    makeBar() {
        this.play = element('button', {className: 'play', textContent: 'Play', title: 'space', onclick: () => this.toggle()});
        this.slider = element('input', {type: 'range', min: 0, max: this.frames.length - 1, value: 0, oninput: () => this.stopAt(+this.slider.value)});
        this.slider.setAttribute('aria-label', 'frame');
        this.clock = element('output');
        const step = (text, by, title) => element('button', {textContent: text, title, onclick: () => this.stopAt(this.at + by)});
        const speed = element('select', {title: 'speed', onchange: () => { this.speed = +speed.value; }});
        for (const s of [0.05, 0.1, 0.25, 0.5, 1, 2, 4]) speed.append(element('option', {value: s, textContent: `${s} x`, selected: s === 1}));
        return element('div', {className: 'bar'}, this.play, step('◀', -1, 'left arrow'), step('▶', 1, 'right arrow'), this.slider, this.clock,
                       speed, element('button', {textContent: 'Slowest', title: 'the frame whose pass took longest', onclick: () => this.stopAt(this.slowest())}),
                       element('button', {textContent: 'Reset view', onclick: () => this.view.home()}));
    }
    makeLayers() {
        const mode = element('select', {onchange: () => { this.view.mode = mode.value, this.show(this.at), this.showLegend(); }});
        for (const [value, textContent] of Object.entries(modes)) mode.append(element('option', {value, textContent}));
        this.cameraChoice = element('select', {title: 'what the picture is seen from', onchange: () => this.view.follow(this.cameraChoice.value === 'scene')});
        this.cameraChoice.append(element('option', {value: 'free', textContent: 'orbit'}), element('option', {value: 'scene', textContent: this.recording.header.camera.orbit ? "the scene's" : 'laparoscope'}));
        const row = element('div', {className: 'bar'}, element('label', {}, 'colour by ', mode), this.legend = element('span', {className: 'legend'}));
        for (const [layer, text] of Object.entries(layerNames)) {
            if (['cells', 'boxes', 'pairs'].includes(layer) && !this.recording.header.cells) continue;
            if (layer === 'links' && !this.recording.header.links) continue;
            if (layer === 'effects' && !this.recording.header.effects) continue;
            if (layer === 'tools' && this.recording.header.tools.length === 0) continue;
            const box = element('input', {type: 'checkbox', checked: ['contacts', 'tools', 'links', 'effects'].includes(layer)});
            box.onchange = () => { this.view.layers[layer] = box.checked, this.show(this.at); };
            row.append(element('label', {}, box, ' ' + text));
        }
        row.append(element('label', {}, 'camera ', this.cameraChoice));
        return row;
    }
    showLegend() {
        const {css, low, high} = legendOf(this.view.mode, this.recording.header, this.view.limits) || {};
        const bar = element('i');
        bar.style.background = `linear-gradient(90deg, ${css})`;
        this.legend.replaceChildren(...(css ? [low, bar, high] : []));
    }
    listen(host) {
        let down = null;
        this.canvas.addEventListener('pointerdown', e => { down = [e.offsetX, e.offsetY]; });
        this.canvas.addEventListener('pointerup', e => {
            if (down && Math.hypot(e.offsetX - down[0], e.offsetY - down[1]) < 4) this.select(this.view.pick(e.offsetX, e.offsetY));
            down = null;
        });
        const keys = {' ': () => this.toggle(), ArrowLeft: () => this.stopAt(this.at - 1), ArrowRight: () => this.stopAt(this.at + 1),
                      Home: () => this.stopAt(0), End: () => this.stopAt(this.frames.length - 1)};
        document.addEventListener('keydown', e => {
            const here = host.matches(':hover') || host.contains(document.activeElement), types = e.target.tagName === 'SELECT' || (e.target.tagName === 'INPUT' && e.target.type === 'text');
            if (!here || !keys[e.key] || types || e.ctrlKey || e.metaKey || e.altKey) return;
            e.preventDefault();
            if (e.target.tagName === 'BUTTON') e.target.blur();  // or space would press it too
            keys[e.key]();
        });
        document.addEventListener('trocar-time', e => {
            this.stopAt(this.frameAt(e.detail));
            host.scrollIntoView({block: 'nearest', behavior: 'smooth'});
        });
    }
    // The frame that shows the end of the pass that begins at a time.
    frameAt(time) {
        const found = this.frames.findIndex(f => f.time > time + 1e-6);
        return found < 0 ? this.frames.length - 1 : found;
    }
    slowest() {
        const cost = this.frames.map(f => f.ms);
        return cost.indexOf(Math.max(...cost));
    }
    toggle() {
        this.playing = !this.playing;
        this.play.textContent = this.playing ? 'Pause' : 'Play';
        if (!this.playing) return;
        if (this.at === this.frames.length - 1) this.show(0);
        let time = this.frames[this.at].time, before = performance.now();
        const turn = now => {
            if (!this.playing) return;
            time += Math.min(0.25, (now - before) * 1e-3) * this.speed, before = now;
            let next = this.at;
            while (next + 1 < this.frames.length && this.frames[next + 1].time <= time) ++next;
            if (next !== this.at) this.show(next);
            if (this.at === this.frames.length - 1) return this.toggle();
            requestAnimationFrame(turn);
        };
        requestAnimationFrame(turn);
    }
    stopAt(frame) {
        if (this.playing) this.toggle();
        this.show(Math.min(this.frames.length - 1, Math.max(0, frame)));
    }
    show(frame) {
        if (frame !== this.at && this.view.selected && !('body' in this.view.selected)) this.view.selected = null;
        this.at = frame, this.slider.value = frame;
        const {time} = this.frames[frame];
        this.clock.textContent = `${time.toFixed(3)} s, ${nameOfPass(this.frames[frame])}`;
        this.view.show(frame);
        this.tell();
        document.dispatchEvent(new CustomEvent('trocar-shown', {detail: time}));
    }
    select(hit) {
        this.view.selected = hit;
        this.view.paint(), this.view.showPairs(this.frames[this.at]), this.view.markContact(), this.view.draw();
        this.tell();
    }
    tell() {
        const hit = this.view.selected, frame = this.frames[this.at];
        const parts = frameFacts(this.recording, frame);
        parts.push(...stageFacts(this.recording, frame, chosen => this.select(chosen), hit));
        if (hit && 'contact' in hit) parts.unshift(...contactFacts(this.recording, frame, hit.contact));
        else if (hit && 'pair' in hit) parts.unshift(...pairFacts(this.recording, frame, hit.pair));
        else if (hit && 'island' in hit) parts.unshift(...islandFacts(this.recording, frame, hit.island));
        else if (hit) parts.unshift(...bodyFacts(this.recording, frame, hit.body));
        else parts.push(element('p', {className: 'hint', textContent: 'Click a body or a contact for its numbers, a plot for its time. Drag turns, wheel zooms, right drag moves.'}));
        this.facts.replaceChildren(...parts);
    }
}
