// node view_check.js PROGRAM [FOLDER]: runs scenes with --view, opens their page in headless Chromium and uses it as a viewer does; exit code
// 1 if something is wrong, 77 (skipped) without Chromium or where the program has no view. FOLDER gets
// pictures of the page.
const {spawn, spawnSync} = require('node:child_process');
const {readFileSync} = require('node:fs');
const {join} = require('node:path');
const {Browser, checkPlaces, end, expect, folder, kPixels, kSkipped} = require('./browser.js');

const program = process.argv[2];
const wet = ['--no-render', '--set', 'liver.triangles=1500', '--set', 'dish.triangles=1500', '--set', 'bleeding=1.0'];
const small = ['--no-render', '--set', 'liver.triangles=1500', '--set', 'probe.triangles=300'];

// A run with a view: its address, and its exit code when it has ended.
function start(out, options, scene) {
    const sizes = scene === 'bleed_and_suck' ? wet : scene === 'laparoscope' ? ['--no-render', '--set', 'liver.triangles=1500'] : small;
    const run = spawn(program, ['run', scene, '--view', ...options, ...sizes, '--out', out], {stdio: ['ignore', 'ignore', 'pipe']});
    const ended = new Promise(done => run.once('exit', done));
    const address = new Promise(done => {
        let text = '';
        run.stderr.setEncoding('utf8').on('data', part => {
            const found = /http:\S+/.exec(text += part);
            if (found) done(found[0]);
        });
        ended.then(() => done(null));
    });
    return {address, ended, pid: run.pid};
}

const button = text => `[...document.querySelectorAll('#player button')].find(b => b.textContent === '${text}')`;
const click = (browser, text) => browser.ask(`${button(text)}.click()`);

async function checkButtons(browser, run, out) {
    expect(await browser.until(`typeof trocarShown === 'object' && globalThis.trocarStatus && trocarStatus.holds`), 'the view starts, and the first holds it');
    expect(await browser.until('trocarStatus.time > 0.3'), 'time goes on');
    const {share, sum} = await browser.ask(kPixels);
    expect(share > 0.02 && share < 0.98, `the picture shows something: ${(100 * share).toFixed(0)} % of it`);
    await click(browser, 'Pause');
    expect(await browser.until('trocarStatus.paused'), 'Pause pauses');
    await browser.until('trocarShown.frames[0].time === trocarStatus.time');
    const pass = await browser.ask('trocarShown.frames[0].pass');
    await new Promise(done => setTimeout(done, 300));
    expect(await browser.ask('trocarShown.frames[0].pass') === pass, 'and nothing moves');
    for (let i = 0; i < 3; ++i) await click(browser, 'Step');
    expect(await browser.until(`trocarShown.frames[0].pass === ${pass + 3}`), 'three steps are three passes');
    await click(browser, 'Start again');
    expect(await browser.until(`trocarShown.frames[0].pass < ${pass}`), 'Start again starts again');
    await click(browser, 'Play');
    expect(await browser.until('trocarShown.frames[0].contacts.length > 0'), 'Play goes on, until they touch');
    expect((await browser.ask(kPixels)).sum !== sum, 'and it looks different');
    await browser.ask(`(s => { s.value = '0.1'; s.dispatchEvent(new Event('change')); })(document.querySelector('#player select'))`);
    expect(await browser.until('trocarStatus.speed === 0.1'), 'speed can be chosen');
    await click(browser, 'Pause');
    await browser.until('trocarStatus.paused && trocarShown.frames[0].time === trocarStatus.time');
    await click(browser, 'End');
    expect(await run.ended === 0, 'End ends the run');
    await checkPlaces(browser, out);
}

async function checkHand(browser, run, out) {
    expect(await browser.until(`typeof trocarShown === 'object' && globalThis.trocarStatus && trocarStatus.holds && trocarStatus.hands.length === 1 && !trocarShown.handLabel.hidden`), 'the mouse may be the hand');
    await browser.ask('trocarShown.handBox.click()');
    const place = () => browser.ask('trocarShown.frames[0].tools[0].device'), before = await place();
    const [x, y] = await browser.middleOf('#player canvas');
    const goals = [[x, y], [x + 60, y], [x + 60, y + 40]];
    for (const [a, b] of goals) await browser.move(a, b), await new Promise(done => setTimeout(done, 400));
    const goal = await browser.ask('trocarShown.handAt');
    expect(await browser.until(`Math.hypot(...trocarShown.frames[0].tools[0].device.map((x, k) => x - trocarShown.handAt[k])) < 1e-4`), `the tool follows it to ${goal}`);
    const after = await place();
    expect(Math.hypot(...after.map((p, k) => p - before[k])) > 0.005, 'which is somewhere else');
    await click(browser, 'End');
    expect(await run.ended === 0, 'End ends the run');
    const again = spawnSync(program, ['run', 'probe_on_liver', ...small, '--replay', join(out, 'live.recording')]);
    expect(again.status === 0, `a replay of it is the same to the bit ${again.status ? again.stdout + again.stderr : ''}`);
}

// Pulls at the soft body with the mouse, changes parameters, asks for a capture and looks through the scene's camera; then the run
// is repeated from what was recorded.
async function checkViewer(browser, run, out) {
    const ready = `typeof trocarShown === 'object' && globalThis.trocarStatus && trocarStatus.holds && trocarShown.status`;
    expect(await browser.until(ready), 'the view starts');
    await browser.ask('trocarShown.dragBox.click()');
    await browser.until('trocarStatus.time > 0.2');
    const soft = await browser.ask('trocarRecording.header.bodies.findIndex(b => b.soft)');
    const [x, y] = await browser.middleOf('#player canvas');
    const [left, top] = await browser.ask(`(r => [r.left, r.top])(document.querySelector('#player canvas').getBoundingClientRect())`);
    let grip = null;
    for (let i = 0; i < 49 && !grip; ++i) {
        const at = [x + 30 * (i % 7 - 3), y + 30 * (Math.floor(i / 7) - 3)];
        if (await browser.ask(`(trocarShown.view.pickBody(${at[0] - left}, ${at[1] - top}) || {}).body`) === soft) grip = at;
    }
    expect(grip, 'the soft body is under the pointer somewhere');
    const mouse = (type, px, py) => browser.send('Input.dispatchMouseEvent', {type, x: px, y: py, button: 'left', buttons: 1, clickCount: 1});
    const camera = await browser.ask('trocarShown.view.camera.position.toArray()');
    await mouse('mousePressed', ...grip);
    for (let step = 1; step <= 12; ++step) await mouse('mouseMoved', grip[0] + 6 * step, grip[1] - 3 * step), await new Promise(done => setTimeout(done, 60));
    expect(await browser.until('trocarShown.frames[0].links.length > 0'), 'a hand holds the soft body by links');
    const stretch = 'Math.max(...trocarShown.frames[0].links.map(([a, b]) => Math.hypot(...a.map((v, k) => v - b[k]))))';
    expect(await browser.until(`${stretch} > 1e-3`), 'and pulls');
    expect(JSON.stringify(await browser.ask('trocarShown.view.camera.position.toArray()')) === JSON.stringify(camera), 'the camera stays meanwhile');
    if (process.argv[3]) await browser.picture(join(process.argv[3], 'drag.png'));
    await mouse('mouseReleased', grip[0] + 72, grip[1] - 36);
    expect(await browser.until('trocarShown.frames[0].links.length === 0'), 'and lets go');
    const set = (key, value) => browser.ask(`trocarShown.setKey.value = '${key}', trocarShown.setValue.value = '${value}', ${button('Set')}.click()`);
    await set('gravity', '[0, 1, -3]');
    expect(await browser.until(`trocarShown.told.textContent.startsWith('gravity = [0, 1, -3] from ')`), 'gravity is changed, and the page says from when');
    await set('liver.tissue.youngs_modulus', '1e3');
    expect(await browser.until(`/can be changed: gravity/.test(trocarShown.told.textContent)`), 'what cannot be changed is refused with what can');
    await set('body.tissue.friction', '0.9');
    expect(await browser.until(`trocarShown.told.textContent.startsWith('body.tissue.friction')`), 'friction is changed');
    await new Promise(done => setTimeout(done, 500));
    await click(browser, 'Capture');
    expect(await browser.until(`/captured: captures.view_\\d+.cap/.test(trocarShown.told.textContent)`), 'a capture is written');
    const capture = (await browser.ask('trocarShown.told.textContent')).replace('captured: ', '');
    const choose = value => browser.ask(`(s => { s.value = '${value}'; s.dispatchEvent(new Event('change')); })(trocarShown.cameraChoice)`);
    await browser.ask('trocarShown.view.camera.position.x += 1');
    await choose('free'), await choose('scene');
    expect((await browser.ask('trocarShown.view.camera.position.toArray()')).every((v, k) => Math.abs(v - camera[k]) < 1e-9), "the scene's camera is where it was at the start");
    await click(browser, 'End');
    expect(await run.ended === 0, 'End ends the run');
    const again = spawnSync(program, ['run', 'probe_on_liver', ...small, '--replay', join(out, 'live.recording')]);
    expect(again.status === 0, `a replay of all that is the same to the bit ${again.status ? again.stdout + again.stderr : ''}`);
    const replayed = spawnSync(program, ['replay', join(out, capture)]);
    expect(replayed.status === 0, `so is the capture ${replayed.status ? replayed.stdout + replayed.stderr : ''}`);
}

// An instructor lets the liver bleed where he clicks; that is recorded and repeated to the bit.
async function checkInstructor(browser, run, out) {
    expect(await browser.until(`typeof trocarShown === 'object' && globalThis.trocarStatus && trocarStatus.holds && trocarShown.status`), 'the view starts');
    const [x, y] = await browser.middleOf('#player canvas');
    const [left, top] = await browser.ask(`(r => [r.left, r.top])(document.querySelector('#player canvas').getBoundingClientRect())`);
    let grip = null;
    for (let i = 0; i < 49 && !grip; ++i) {
        const at = [x + 30 * (i % 7 - 3), y + 30 * (Math.floor(i / 7) - 3)];
        if (await browser.ask(`(trocarShown.view.pickBody(${at[0] - left}, ${at[1] - top}) || {}).body`) === 0) grip = at;
    }
    expect(grip && !await browser.ask('trocarShown.injectChoice.hidden'), 'the liver is under the pointer somewhere, and may bleed');
    const blood = `(f => f ? f.thickness.reduce((s, h, v) => s + h * f.blood[v], 0) : 0)(trocarShown.frames[0].effects.films.get(0))`;
    await browser.ask(`trocarShown.injectChoice.value = 'bleed'`);
    await browser.click(...grip);
    expect(await browser.until(`/^liver bleeds 60 ml.min from/.test(trocarShown.told.textContent)`), 'a click lets it bleed, and the page says so');
    const before = await browser.ask(blood);
    expect(await browser.until(`${blood} > ${before} + 2e-4`), 'blood comes');
    if (process.argv[3]) await browser.picture(join(process.argv[3], 'bleeds.png'));
    await browser.ask(`trocarShown.injectChoice.value = 'slip'`);
    await browser.click(...grip);
    expect(await browser.until(`trocarShown.told.textContent === 'no staple is near'`), 'where no staple is none slips');
    await click(browser, 'End');
    expect(await run.ended === 0, 'End ends the run');
    const again = spawnSync(program, ['run', 'bleed_and_suck', ...wet, '--replay', join(out, 'live.recording')]);
    expect(again.status === 0, `a replay of all that is the same to the bit ${again.status ? again.stdout + again.stderr : ''}`);
}

// A laparoscope in the hand: its picture is round, and what it sees moves with the hand.
async function checkScope(browser, run) {
    expect(await browser.until(`typeof trocarShown === 'object' && globalThis.trocarStatus && trocarStatus.holds`), 'the view starts');
    await click(browser, 'Start again');
    await browser.until('trocarStatus.time < 2');
    await browser.ask(`(s => { s.value = 'scene'; s.dispatchEvent(new Event('change')); })(trocarShown.cameraChoice)`);
    const eye = () => browser.ask('trocarShown.view.camera.position.toArray()'), before = await eye();
    // the lens is where the body that holds it is, at the place that the scene says
    const off = `(() => {
        const {camera, bodies, turn_step: turn} = trocarRecording.header, {held} = camera, {at} = trocarShown.frames[0].bodies[held.body], step = bodies[held.body].step;
        const [w, a, b, c] = Array.from(at).slice(3, 7).map(v => v * turn), [x, y, z] = held.position, n = Math.hypot(w, a, b, c);
        const u = [b * z - c * y + w * x, c * x - a * z + w * y, a * y - b * x + w * z];
        const p = [x + 2 * (b * u[2] - c * u[1]) / n / n, y + 2 * (c * u[0] - a * u[2]) / n / n, z + 2 * (a * u[1] - b * u[0]) / n / n];
        const now = trocarShown.view.camera.position.toArray();
        return Math.max(...p.map((v, k) => Math.abs(v + at[k] * step - now[k])));
    })()`;
    expect(await browser.ask(off) < 1e-6, 'the lens is on its body');
    expect(await browser.ask(`trocarShown.canvas.style.clipPath.startsWith('circle') && !trocarShown.view.controls.enabled`), 'the picture is round, and the pointer does not turn it');
    // the hand rests for a while
    const moved = `Math.hypot(...trocarShown.view.camera.position.toArray().map((v, k) => v - ${JSON.stringify(before)}[k])) > 1e-3`;
    expect(await browser.until(moved), 'it moves with the hand');
    expect(await browser.ask(off) < 1e-6, 'and is still on its body');
    if (process.argv[3]) await browser.picture(join(process.argv[3], 'scope.png'));
    await browser.ask(`(s => { s.value = 'free'; s.dispatchEvent(new Event('change')); })(trocarShown.cameraChoice)`);
    expect(await browser.ask(`trocarShown.canvas.style.clipPath === '' && trocarShown.view.controls.enabled`), 'orbit gives the pointer its camera back');
    await click(browser, 'End');
    expect(await run.ended === 0, 'End ends the run');
}

// As fast as it goes for thousands of passes: neither the page nor the program keeps them.
async function checkMemory(browser, run, out) {
    expect(await browser.until(`typeof trocarShown === 'object' && globalThis.trocarStatus && trocarStatus.holds`), 'the view starts');
    const kept = async () => {
        await browser.send('HeapProfiler.collectGarbage');
        const {usedSize} = await browser.send('Runtime.getHeapUsage');
        return {bytes: usedSize, ...await browser.ask('({...trocarShown.view.renderer.info.memory, frames: trocarShown.frames.length})')};
    };
    await browser.ask(`trocarShown.layers.querySelectorAll('input[type=checkbox]').forEach(box => box.checked || box.click())`);
    await browser.ask(`trocarShown.send({do: 'speed', value: 100})`);
    await browser.until('trocarShown.frames[0].pass > 300');
    const before = await kept();
    await browser.until('trocarShown.frames[0].pass > 3000');
    const after = await kept();
    expect(after.frames === 1 && after.geometries <= before.geometries + 4 && after.textures <= before.textures + 2, `one frame is kept, ${after.geometries} geometries, ${after.textures} textures`);
    expect(after.bytes < before.bytes + 4e6, `the page keeps ${(after.bytes / 1e6).toFixed(1)} MB, ${(before.bytes / 1e6).toFixed(1)} before`);
    await click(browser, 'End');
    expect(await run.ended === 0, 'End ends the run');
    const rows = readFileSync(join(out, 'passes.csv'), 'utf8').trim().split('\n').length - 1, metrics = JSON.parse(readFileSync(join(out, 'metrics.json')));
    expect(rows === 200 && metrics.kept_s < metrics.simulated_s / 10, `results cover ${rows} passes, ${metrics.kept_s} of ${metrics.simulated_s} s`);
    const again = spawnSync(program, ['run', 'probe_on_liver', ...small, '--json', '--replay', join(out, 'live.recording')], {encoding: 'utf8'});
    expect(again.status === 0 && Math.abs(JSON.parse(again.stdout).simulated_s - metrics.kept_s) < 0.02, 'so does the recording, which is repeated to the bit');
}

// Nor does the program: without a bound every pass would add 1.7 kB of figures, 29 MB in all.
async function checkLong(browser, run) {
    expect(await browser.until(`typeof trocarShown === 'object' && globalThis.trocarStatus && trocarStatus.holds`), 'the view starts');
    await browser.ask(`trocarShown.send({do: 'speed', value: 100})`);
    const resident = () => +/VmRSS:\s+(\d+) kB/.exec(readFileSync(`/proc/${run.pid}/status`, 'utf8'))[1] / 1024;  // MiB
    await browser.until('trocarShown.frames[0].pass > 3000');
    const before = resident();
    expect(await browser.until('trocarShown.frames[0].pass > 20000'), 'twenty thousand passes');
    const after = resident();
    expect(after < before + 4, `the program keeps ${after.toFixed(1)} MiB, ${before.toFixed(1)} after three thousand passes`);
    await click(browser, 'End');
    expect(await run.ended === 0, 'End ends the run');
}

async function check(name, options, use, scene = 'probe_on_liver') {
    const out = join(folder, name), run = start(out, options, scene), address = await run.address;
    if (!address) return false;
    const browser = new Browser();
    try {
        await browser.open(address);
        await use(browser, run, out);
        const errors = browser.errors.filter(e => !/WebSocket|ERR_CONNECTION_REFUSED/.test(JSON.stringify(e.params)));  // it is gone in the end
        expect(errors.length === 0, `nothing is wrong in the console ${errors.map(e => JSON.stringify(e.params)).join('\n')}`);
    } finally {
        await browser.close();
    }
    return true;
}

end(async () => {
    if (!await check('lockstep', [], checkButtons)) {
        console.log('skipped: the program has no view');
        return kSkipped;
    }
    await check('live', ['--live', '--device', 'probe=browser'], checkHand);
    await check('viewer', ['--capture', 'view'], checkViewer);
    await check('instructor', [], checkInstructor, 'bleed_and_suck');
    await check('scope', [], checkScope, 'laparoscope');
    await check('memory', ['--keep-passes', '200'], checkMemory);
    await check('long', ['--keep-passes', '200', '--figures-only'], checkLong);
    return 0;
});
