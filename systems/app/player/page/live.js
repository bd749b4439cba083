// A run as it is: frames that `trocar run --view` sends, buttons that it obeys, and the mouse as a hand.
import {readLiveFrame, readRecording} from './data.js';
import {Player, element} from './player.js';

const handPeriod = 8;  // ms between two places of the hand
const openGrip = 0.5;  // rad
const bleeding = 1e-6; // m^3/s, 60 ml/min, of a vessel that an instructor opens
const marked = ['gravity', 'contact.tolerance', 'contact.push_speed', 'contact.iterations', 'substep', 'body.tissue.friction', 'body.tissue.damping', 'body.tissue.restitution'];
const again = 1000;    // ms, until the next try to connect

class LivePlayer extends Player {
    constructor(host, recording, send) {
        super(host, recording);
        this.send = send, this.handAt = null, this.grip = openGrip, this.buttons = 0, this.sent = 0;
        this.listenToHand(host);
        this.listenToDrags();
    }
    makeBar() {
        const button = (text, title, click) => element('button', {textContent: text, title, onclick: click});
        const say = word => () => this.send({do: word});
        this.play = button('Pause', 'space', () => this.toggle()), this.play.className = 'play';
        this.slider = element('input');  // of the player of recordings; not shown
        this.clock = element('output');
        this.speedChoice = element('select', {title: 'speed', onchange: () => this.send({do: 'speed', value: +this.speedChoice.value})});
        for (const s of [0.01, 0.05, 0.1, 0.25, 0.5, 1, 2, 4, 100]) this.speedChoice.append(element('option', {value: s, textContent: s === 100 ? 'fastest' : `${s} x`, selected: s === 1}));
        this.handBox = element('input', {type: 'checkbox', onchange: () => this.holdHand(this.handBox.checked)});
        this.handLabel = element('label', {hidden: true, title: 'the mouse moves the tool across the view, the wheel along it; g opens and closes the grip, 1 to 4 are buttons, Escape lets go'}, this.handBox, ' mouse is the hand');
        this.holdButton = button('Take over', 'be the one whose buttons count', say('hold'));
        this.stateText = element('output');
        this.dragBox = element('input', {type: 'checkbox'});
        this.injectChoice = element('select', {title: 'an instructor: choose, then click on where it happens', hidden: !this.recording.header.effects});
        for (const [value, textContent] of [['', 'let happen ...'], ['bleed', 'a bleeding (60 ml/min)'], ['slip', 'a slipped staple']]) this.injectChoice.append(element('option', {value, textContent}));
        this.captureButton = button('Capture', 'write the last passes to a .cap file', say('capture')), this.captureButton.hidden = true;
        this.setKey = element('input', {size: 18, placeholder: 'gravity', title: 'a parameter that may be changed while the run lasts'});
        this.setKey.setAttribute('list', 'marked');
        this.setValue = element('input', {size: 12, placeholder: '[0, 0, -9.81]', title: 'its value, as in a scene file'});
        const names = element('datalist', {id: 'marked'}, ...marked.map(value => element('option', {value})));
        const set = button('Set', 'from the next pass on', () => this.send({do: 'set', key: this.setKey.value.trim(), value: this.setValue.value.trim()}));
        this.setValue.onkeydown = e => { if (e.key === 'Enter') set.click(); };
        this.told = element('output', {className: 'told'});
        return element('div', {className: 'bar'}, this.play, button('Step', 'right arrow', say('step')), this.speedChoice, this.clock,
                       button('Start again', 'from the first pass', say('reset')), button('End', 'end the run: its results are written', say('end')),
                       button('Reset view', '', () => this.view.home()), this.handLabel,
                       element('label', {title: 'pull at a soft or free body with the mouse; also with Shift held'}, this.dragBox, ' drag bodies'), this.injectChoice,
                       this.captureButton, names, this.setKey, this.setValue, set, this.holdButton, this.stateText, this.told);
    }
    toggle() { this.send({do: this.status && this.status.paused ? 'play' : 'pause'}); }
    stopAt() { this.send({do: 'step'}); }
    take(frame) {
        this.frames[0] = frame;
        const {limits} = this.view;
        for (const c of frame.contacts) limits.depth = Math.max(limits.depth, -c.distance), limits.push = Math.max(limits.push, c.push);
        for (const t of frame.tools) limits.hand = Math.max(limits.hand, Math.hypot(...t.force));
        this.show(0);
    }
    heed(status) {
        this.status = status;
        this.play.textContent = status.paused ? 'Play' : 'Pause';
        this.captureButton.hidden = !status.captures, this.told.textContent = status.told;
        this.speedChoice.hidden = !status.paced, this.speedChoice.value = status.speed;
        this.holdButton.hidden = status.holds || status.held;
        this.handLabel.hidden = !status.holds || status.hands.length === 0;
        for (const control of this.bar.querySelectorAll('button,select')) control.disabled = !status.holds && control !== this.holdButton && control.textContent !== 'Reset view';
        this.stateText.textContent = (status.paused ? 'paused' : `${status.rate.toFixed(2)} x real time`) + (status.holds ? '' : ', watching') +
            (status.clients > 1 ? `, ${status.clients} viewers` : '');
    }
    get tool() { return this.recording.header.tools.findIndex(t => t.body === this.status.hands[0]); }
    holdHand(on) {
        this.view.controls.enabled = !on && !this.view.follows;
        this.handAt = on ? this.frames[0].tools[this.tool].device.slice() : null;
        this.canvas.style.cursor = on ? 'crosshair' : '';
        if (on) this.canvas.focus();
    }
    sendHand() {
        const now = performance.now();
        if (!this.handAt || now - this.sent < handPeriod) return;
        this.sent = now;
        const tip = this.handAt.map((x, k) => x + this.recording.header.origin[k]);
        this.send({do: 'hand', body: this.status.hands[0], tip, grip: this.grip, buttons: this.buttons});
    }
    // A click after a choice of what is to happen says where; another click chooses what to look at.
    select(hit) {
        const what = this.injectChoice.value;
        if (!what || !hit) return super.select(hit);
        const {contacts} = this.frames[0], at = 'contact' in hit ? contacts[hit.contact] : hit;
        this.send({do: what, body: at.body, point: at.point.map((x, k) => x + this.recording.header.origin[k]), rate: bleeding});
        this.injectChoice.value = '';
    }
    // A body under the pointer is pulled while the button is down; beside one the camera turns.
    listenToDrags() {
        const toWorld = point => point.map((x, k) => x + this.recording.header.origin[k]);
        this.canvas.addEventListener('pointerdown', e => {
            if (e.button !== 0 || this.handAt || !(this.dragBox.checked || e.shiftKey) || !this.status || !this.status.holds) return;
            const hit = this.view.pickBody(e.offsetX, e.offsetY);
            if (!hit) return;
            this.dragAt = hit.point, this.view.controls.enabled = false;
            this.canvas.setPointerCapture(e.pointerId);
            this.send({do: 'grab', body: hit.body, point: toWorld(hit.point)});
        }, {capture: true});
        this.canvas.addEventListener('pointermove', e => {
            if (!this.dragAt) return;
            this.dragAt = this.view.onPlane(e.offsetX, e.offsetY, this.dragAt);
            const now = performance.now();
            if (now - this.sent < handPeriod) return;
            this.sent = now, this.send({do: 'pull', point: toWorld(this.dragAt)});
        });
        const letGo = () => {
            if (!this.dragAt) return;
            this.dragAt = null, this.view.controls.enabled = !this.view.follows;
            this.send({do: 'let'});
        };
        for (const end of ['pointerup', 'pointercancel']) this.canvas.addEventListener(end, letGo);
    }
    listenToHand(host) {
        this.canvas.addEventListener('pointermove', e => {
            if (!this.handAt) return;
            this.handAt = this.view.onPlane(e.offsetX, e.offsetY, this.handAt);
            this.sendHand();
        });
        this.canvas.addEventListener('wheel', e => {
            if (!this.handAt) return;
            e.preventDefault();
            this.handAt = this.view.deeper(this.handAt, -2e-5 * e.deltaY);
            this.sent = 0, this.sendHand();
        }, {passive: false});
        const bit = key => '1234'.includes(key) && key.length === 1 ? 1 << '1234'.indexOf(key) : 0;
        document.addEventListener('keydown', e => {
            if (!this.handAt) return;
            if (e.key === 'Escape') this.handBox.checked = false, this.holdHand(false);
            if (e.key === 'g' && !e.repeat) this.grip = this.grip > 0 ? 0 : openGrip;
            this.buttons |= bit(e.key);
            this.sent = 0, this.sendHand();
        });
        document.addEventListener('keyup', e => { this.buttons &= ~bit(e.key), this.sent = 0, this.sendHand(); });
    }
}

// Whether two recordings show the same bodies.
function same(a, b) {
    return JSON.stringify(a.header.bodies) === JSON.stringify(b.header.bodies) && a.meshes.every((m, i) => m.triangles.length === b.meshes[i].triangles.length);
}

// Connects with the token that stands after # in the address, and again when the run is gone: it may be started anew.
export function startLive(host) {
    let player = null, recording = null;
    const tell = text => { host.replaceChildren(element('p', {textContent: text})); player = recording = null; };
    if (!document.createElement('canvas').getContext('webgl2')) return tell('This browser has no WebGL 2.');
    const connect = () => {
        const socket = new WebSocket(`ws://${location.host}/`, 'trocar-view');
        socket.binaryType = 'arraybuffer';
        const send = message => socket.readyState === 1 && socket.send(JSON.stringify(message));
        socket.onopen = () => { socket.send(location.hash.slice(1)), send({do: 'hold'}); };
        socket.onmessage = ({data}) => {
            if (typeof data === 'string') {
                globalThis.trocarStatus = JSON.parse(data);
                if (player) player.heed(globalThis.trocarStatus);
                return;
            }
            const bytes = new Uint8Array(data);
            if (bytes[0] === 0) {
                const started = readRecording(bytes.slice(1));
                if (player && same(started, recording)) return player.take(started.frames[0]);  // from the first pass again, or this browser was too slow
                if (player) player.view.dispose();
                globalThis.trocarRecording = recording = started;
                document.title = document.querySelector('h1').textContent = recording.header.scene;
                globalThis.trocarShown = player = new LivePlayer(host, recording, send);
                if (globalThis.trocarStatus) player.heed(globalThis.trocarStatus);
            } else if (player) {
                player.take(readLiveFrame(bytes.slice(1), recording, recording.frames[0]));
            }
        };
        socket.onclose = () => {
            tell(player ? 'The run has ended, or its program is gone.' : 'No run answers at this address with this token. Trying again.');
            setTimeout(connect, again);
        };
    };
    connect();
}
