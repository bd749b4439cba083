// node view_check.js PROGRAM: runs scenes with --view, opens their page in headless Chromium and uses it as a viewer does; exit code
// 1 if something is wrong, 77 (skipped) without Chromium or where the program has no view.
const {spawn, spawnSync} = require('node:child_process');
const {join} = require('node:path');
const {Browser, checkPlaces, end, expect, folder, kPixels, kSkipped} = require('./browser.js');

const program = process.argv[2];
const small = ['--no-render', '--set', 'liver.triangles=1500', '--set', 'probe.triangles=300'];

// A run with a view: its address, and its exit code when it has ended.
function start(out, options) {
    const run = spawn(program, ['run', 'probe_on_liver', '--view', ...options, ...small, '--out', out], {stdio: ['ignore', 'ignore', 'pipe']});
    const ended = new Promise(done => run.once('exit', done));
    const address = new Promise(done => {
        let text = '';
        run.stderr.setEncoding('utf8').on('data', part => {
            const found = /http:\S+/.exec(text += part);
            if (found) done(found[0]);
        });
        ended.then(() => done(null));
    });
    return {address, ended};
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

async function check(name, options, use) {
    const out = join(folder, name), run = start(out, options), address = await run.address;
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
    return 0;
});
