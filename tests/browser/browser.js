// What the checks of pages share: headless Chromium over the DevTools protocol on two pipes (no package is needed), a folder, a count
// of failures, and what a page shows.
const {spawn, spawnSync} = require('node:child_process');
const {mkdtempSync, readdirSync, readFileSync, rmSync, writeFileSync} = require('node:fs');
const {tmpdir} = require('node:os');
const {join} = require('node:path');

const kSkipped = 77, kPatience = 60_000;  // ms, for a software renderer on a busy machine
const chromium = ['chromium', 'chromium-browser', 'google-chrome'].find(name => spawnSync(name, ['--version']).status === 0);
if (!chromium) {
    console.log('skipped: no Chromium');
    process.exit(kSkipped);
}
const folder = mkdtempSync(join(tmpdir(), 'trocar_browser_'));
let failures = 0;
const expect = (holds, what) => {
    if (!holds) ++failures;
    console.log(`${holds ? 'ok    ' : 'FAILED'} ${what}`);
};

class Browser {
    constructor() {
        this.waiting = new Map(), this.heard = [], this.last = 0;
        this.process = spawn(chromium, ['--headless', '--no-sandbox', '--remote-debugging-pipe', `--user-data-dir=${join(folder, 'profile')}`,
            '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--disable-quic', '--no-first-run', '--disable-background-networking',
            '--disable-component-update', '--disable-smooth-scrolling', '--disable-sync', '--disable-dev-shm-usage', '--window-size=1200,900'], {stdio: ['ignore', 'ignore', 'ignore', 'pipe', 'pipe']});
        let text = '';
        this.process.stdio[4].setEncoding('utf8').on('data', part => {
            const messages = (text += part).split('\0');
            text = messages.pop();
            for (const message of messages.map(m => JSON.parse(m))) {
                if (message.id) this.waiting.get(message.id)(message), this.waiting.delete(message.id);
                else this.heard.push(message);
            }
        });
    }
    send(method, params = {}) {
        const id = ++this.last;
        this.process.stdio[3].write(JSON.stringify({id, method, params, sessionId: this.session}) + '\0');
        return new Promise((done, fail) => this.waiting.set(id, m => m.error ? fail(new Error(`${method}: ${m.error.message}`)) : done(m.result)));
    }
    async open(address) {
        const {targetId} = await this.send('Target.createTarget', {url: 'about:blank'});
        this.session = (await this.send('Target.attachToTarget', {targetId, flatten: true})).sessionId;
        for (const domain of ['Page', 'Runtime', 'Network', 'Log']) await this.send(`${domain}.enable`);
        await this.send('Page.navigate', {url: address});
    }
    async ask(expression) {
        const {result, exceptionDetails} = await this.send('Runtime.evaluate', {expression, returnByValue: true, awaitPromise: true});
        if (exceptionDetails) throw new Error(exceptionDetails.exception?.description || exceptionDetails.text);
        return result.value;
    }
    async until(expression) {
        for (const end = Date.now() + kPatience; Date.now() < end; await new Promise(done => setTimeout(done, 100)))
            if (await this.ask(expression)) return true;
        return false;
    }
    async press(key) {
        const code = key === ' ' ? 'Space' : key, text = key === ' ' ? ' ' : undefined;
        await this.send('Input.dispatchKeyEvent', {type: 'keyDown', key, code, text});
        await this.send('Input.dispatchKeyEvent', {type: 'keyUp', key, code});
    }
    async move(x, y) { await this.send('Input.dispatchMouseEvent', {type: 'mouseMoved', x, y}); }
    async click(x, y) {
        await this.move(x, y);
        for (const type of ['mousePressed', 'mouseReleased']) await this.send('Input.dispatchMouseEvent', {type, x, y, button: 'left', clickCount: 1});
    }
    async picture(file) {
        const {data} = await this.send('Page.captureScreenshot', {format: 'png'});
        writeFileSync(file, Buffer.from(data, 'base64'));
    }
    async close() {
        const ended = new Promise(done => this.process.once('exit', done));
        this.session = undefined, this.send('Browser.close');
        await ended;
    }
    get errors() {
        return this.heard.filter(m => m.method === 'Runtime.exceptionThrown' || (m.method === 'Log.entryAdded' && m.params.entry.level === 'error'));
    }
    // Moves the pointer over an element, and says where that is; again where the page moved meanwhile.
    async hover(selector) {
        for (const end = Date.now() + kPatience; Date.now() < end; await new Promise(done => setTimeout(done, 200))) {
            const [x, y] = await this.middleOf(selector);
            await this.move(x - 1, y);
            await this.move(x, y);
            if (await this.ask(`document.querySelector(${JSON.stringify(selector)}).matches(':hover')`)) return [x, y];
        }
        return null;
    }
    // Scrolls there and waits until the page has come to rest: a click on a plot scrolls smoothly.
    async middleOf(selector) {
        const element = `document.querySelector(${JSON.stringify(selector)})`;
        await this.ask(`${element}.scrollIntoView({block: 'center', behavior: 'instant'})`);
        const middle = () => this.ask(`(r => [r.left + r.width / 2, r.top + r.height / 2])(${element}.getBoundingClientRect())`);
        for (let last; ; await new Promise(done => setTimeout(done, 150))) {
            const now = await middle();
            if (last && last[0] === now[0] && last[1] === now[1]) return now;
            last = now;
        }
    }
}

// Share of the canvas that is not background, and a number that depends on every pixel.
const kPixels = `(() => {
    const {renderer, scene, camera} = trocarShown.view, gl = renderer.getContext();
    renderer.render(scene, camera);
    const [w, h] = [gl.drawingBufferWidth, gl.drawingBufferHeight], pixels = new Uint8Array(4 * w * h);
    gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    let drawn = 0, sum = 0;
    for (let i = 0; i < pixels.length; i += 4) {
        drawn += Math.abs(pixels[i] - pixels[0]) + Math.abs(pixels[i + 1] - pixels[1]) + Math.abs(pixels[i + 2] - pixels[2]) > 30;
        sum = (31 * sum + pixels[i] + 7 * pixels[i + 1] + 3 * pixels[i + 2]) % 1000003;
    }
    return {share: drawn / (w * h), sum};
})()`;

// World places of the vertices of a body in the last frame, as the page has decoded them.
const places = body => `(() => {
    const {header, meshes, frames} = trocarRecording, b = header.bodies[${body}], {at} = frames.at(-1).bodies[${body}];
    if (b.soft) return Array.from(at, (x, i) => x * b.step + header.origin[i % 3]);
    const t = header.turn_step, [w, x, y, z] = [at[3] * t, at[4] * t, at[5] * t, at[6] * t], p = meshes[b.mesh].position, out = [];
    for (let i = 0; i < p.length; i += 3) {
        const [a, c, d] = [p[i], p[i + 1], p[i + 2]], u = [y * d - z * c + w * a, z * a - x * d + w * c, x * c - y * a + w * d];
        out.push(a + 2 * (y * u[2] - z * u[1]), c + 2 * (z * u[0] - x * u[2]), d + 2 * (x * u[1] - y * u[0]));
    }
    return out.map((v, i) => v + at[i % 3] * b.step + header.origin[i % 3]);
})()`;

function objVertices(file) {
    return readFileSync(file, 'utf8').split('\n').filter(line => line.startsWith('v ')).flatMap(line => line.split(' ').slice(1, 4).map(Number));
}

// Compares every vertex that a page shows in its last frame with the meshes that the run left.
async function checkPlaces(browser, run) {
    const bodies = await browser.ask('trocarRecording.header.bodies.map(b => ({name: b.name, step: b.step, soft: b.soft}))');
    for (const [i, {name, step, soft}] of bodies.entries()) {
        const meshes = join(run, 'meshes'), file = readdirSync(meshes).filter(f => f.endsWith(`_${name}.obj`)).sort().pop();
        const truth = objVertices(join(meshes, file)), shown = await browser.ask(places(i));
        const worst = truth.reduce((w, x, k) => Math.max(w, Math.abs(x - shown[k])), 0);
        expect(truth.length > 0 && truth.length === shown.length && worst <= (soft ? 0.51 : 2) * step, `${name}: ${truth.length / 3} vertices where the run left them, to ${(worst * 1e6).toFixed(2)} um`);
    }
}

// Runs a check, which returns an exit code unless something failed, and ends the program.
function end(main) {
    main().catch(error => { console.log(error); return 1; }).then(code => {
        rmSync(folder, {recursive: true, force: true, maxRetries: 20, retryDelay: 100});
        process.exit(code || (failures > 0 ? 1 : 0));
    });
}

module.exports = {Browser, checkPlaces, end, expect, folder, kPixels, kSkipped};
