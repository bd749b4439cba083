// node player_check.js PROGRAM [PAGE]: runs a scene, opens its report.html from the disk in headless Chromium and uses the player
// as a viewer does; exit code 1 if something is wrong, 77 (skipped) without Chromium or without a player in the program. Speaks
// the DevTools protocol over two pipes: no package is needed. With PAGE it only tries a page that is there.
const {execFileSync, spawn, spawnSync} = require('node:child_process');
const {mkdtempSync, readdirSync, readFileSync, rmSync} = require('node:fs');
const {tmpdir} = require('node:os');
const {join} = require('node:path');

const kSkipped = 77, kPatience = 60_000;  // ms, for a software renderer on a busy machine
const [program, givenPage] = process.argv.slice(2);
const chromium = ['chromium', 'chromium-browser', 'google-chrome'].find(name => spawnSync(name, ['--version']).status === 0);
if (!chromium) {
    console.log('skipped: no Chromium');
    process.exit(kSkipped);
}
const folder = mkdtempSync(join(tmpdir(), 'trocar_player_'));
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
            '--disable-component-update', '--disable-sync', '--disable-dev-shm-usage', '--window-size=1200,900'], {stdio: ['ignore', 'ignore', 'ignore', 'pipe', 'pipe']});
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
    async open(page) {
        const {targetId} = await this.send('Target.createTarget', {url: 'about:blank'});
        this.session = (await this.send('Target.attachToTarget', {targetId, flatten: true})).sessionId;
        for (const domain of ['Page', 'Runtime', 'Network', 'Log']) await this.send(`${domain}.enable`);
        await this.send('Page.navigate', {url: 'file://' + page});
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
    async middleOf(selector) {
        await this.ask(`document.querySelector(${JSON.stringify(selector)}).scrollIntoView({block: 'center'})`);
        return this.ask(`(r => [r.left + r.width / 2, r.top + r.height / 2])(document.querySelector(${JSON.stringify(selector)}).getBoundingClientRect())`);
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

async function checkPlaces(browser) {
    const bodies = await browser.ask('trocarRecording.header.bodies.map(b => ({name: b.name, step: b.step, soft: b.soft}))');
    for (const [i, {name, step, soft}] of bodies.entries()) {
        const meshes = join(folder, 'run', 'meshes'), file = readdirSync(meshes).filter(f => f.endsWith(`_${name}.obj`)).sort().pop();
        const truth = objVertices(join(meshes, file)), shown = await browser.ask(places(i));
        const worst = truth.reduce((w, x, k) => Math.max(w, Math.abs(x - shown[k])), 0);
        expect(truth.length > 0 && truth.length === shown.length && worst <= (soft ? 0.51 : 2) * step, `${name}: ${truth.length / 3} vertices where the run left them, to ${(worst * 1e6).toFixed(2)} um`);
    }
}

async function checkUse(browser) {
    const at = () => browser.ask('trocarShown.at'), frames = await browser.ask('trocarRecording.frames.length');
    const first = await browser.ask(kPixels);
    expect(first.share > 0.02 && first.share < 0.98, `the picture shows something: ${(100 * first.share).toFixed(0)} % of it`);
    const [x, y] = await browser.middleOf('#player canvas');
    await browser.move(x, y);
    await browser.press('End');
    expect(await at() === frames - 1, 'End goes to the last frame');
    expect((await browser.ask(kPixels)).sum !== first.sum, 'which looks different');
    await browser.press('ArrowLeft');
    expect(await at() === frames - 2, 'an arrow steps');
    await browser.press('Home'), await browser.press(' ');
    expect(await browser.until('trocarShown.at > 0'), 'space plays');
    await browser.press(' ');
    expect(!(await browser.ask('trocarShown.playing')), 'and stops');
    await browser.ask(`document.querySelector('#player input[type=range]').value = 3; document.querySelector('#player input[type=range]').dispatchEvent(new Event('input'))`);
    expect(await at() === 3, 'the slider scrubs');
    await browser.ask(`[...document.querySelectorAll('#player label')].find(l => /^ contacts$/.test(l.textContent))?.querySelector('input').click()`);
    const facts = `document.querySelector('#player h3').textContent`, names = await browser.ask('trocarRecording.header.bodies.map(b => b.name)');
    let hit = '';
    for (let i = 0; i < 25 && !names.includes(hit); ++i) {
        await browser.click(x + 40 * (i % 5 - 2), y + 40 * (Math.floor(i / 5) - 2));
        hit = await browser.ask(facts);
    }
    expect(names.includes(hit), `a click on a body names it: ${hit}`);
    const sums = new Set();
    for (const mode of await browser.ask(`[...document.querySelector('#player label select').options].map(o => o.value)`)) {
        await browser.ask(`(s => { s.value = '${mode}'; s.dispatchEvent(new Event('change')); })(document.querySelector('#player label select'))`);
        sums.add((await browser.ask(kPixels)).sum);
    }
    expect(sums.size >= 3, `ways to colour differ: ${sums.size}`);
    await browser.ask(`document.querySelectorAll('#player input[type=checkbox]').forEach(box => box.click())`);
    expect(!sums.has((await browser.ask(kPixels)).sum), 'so do layers');
}

async function checkPlots(browser) {
    expect(await browser.ask(`document.querySelectorAll('nav a').length > 5`), 'there is a list of contents');
    const [x, y] = await browser.middleOf('svg.timed polyline');
    await browser.move(x, y);
    expect(await browser.ask(`getComputedStyle(document.querySelector('.tip')).display === 'block' && /\\d/.test(document.querySelector('.tip').textContent)`), 'a plot tells its values');
    await browser.ask('trocarShown.show(0)');
    await browser.click(x, y);
    expect(await browser.ask('trocarShown.at > 0'), 'a click on it goes there');
}

async function main() {
    let page = givenPage;
    if (!page) {
        page = join(folder, 'run', 'report.html');
        execFileSync(program, ['run', 'probe_on_liver', '--seconds', '1.2', '--no-render', '--set', 'liver.triangles=1500', '--set', 'probe.triangles=300',
            '--out', join(folder, 'run')], {stdio: 'ignore'});
        if (!readFileSync(page, 'utf8').includes('id="player-recording"')) {
            console.log('skipped: the program was built without the player');
            return kSkipped;
        }
    }
    const browser = new Browser();
    try {
        await browser.open(page);
        expect(await browser.until(`typeof trocarShown === 'object'`), 'the player starts');
        if (!givenPage) await checkPlaces(browser), await checkPlots(browser);
        await checkUse(browser);
        const requests = browser.heard.filter(m => m.method === 'Network.requestWillBeSent').map(m => m.params.request.url).filter(url => !/^(file|data|blob):/.test(url));
        expect(requests.length === 0, `nothing is asked of a network ${requests.join(' ')}`);
        const errors = browser.heard.filter(m => m.method === 'Runtime.exceptionThrown' || (m.method === 'Log.entryAdded' && m.params.entry.level === 'error'));
        expect(errors.length === 0, `nothing is wrong in the console ${errors.map(e => JSON.stringify(e.params)).join('\n')}`);
    } finally {
        const ended = new Promise(done => browser.process.once('exit', done));
        browser.session = undefined, browser.send('Browser.close');
        await ended;
    }
    return failures > 0 ? 1 : 0;
}

main().catch(error => { console.log(error); return 1; }).then(code => {
    rmSync(folder, {recursive: true, force: true, maxRetries: 20, retryDelay: 100});
    process.exit(code);
});
