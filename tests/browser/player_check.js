// node player_check.js PROGRAM [PAGE]: runs a scene, opens its report.html from the disk in headless Chromium and uses the player
// as a viewer does; exit code 1 if something is wrong, 77 (skipped) without Chromium or without a player in the program. With
// PAGE it only tries a page that is there.
const {execFileSync} = require('node:child_process');
const {readFileSync} = require('node:fs');
const {join} = require('node:path');
const {Browser, checkPlaces, end, expect, folder, kPixels, kSkipped} = require('./browser.js');

const [program, givenPage] = process.argv.slice(2);

async function checkUse(browser) {
    const at = () => browser.ask('trocarShown.at'), frames = await browser.ask('trocarRecording.frames.length');
    const first = await browser.ask(kPixels);
    expect(first.share > 0.02 && first.share < 0.98, `the picture shows something: ${(100 * first.share).toFixed(0)} % of it`);
    const over = await browser.hover('#player canvas');
    expect(over, 'the pointer is over it');
    const [x, y] = over ?? [0, 0];
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

// The page of a capture: what each stage of a pass left, and lists that show what is clicked on.
async function checkInspection(browser) {
    expect(await browser.until(`typeof trocarShown === 'object'`), 'the player of a capture starts');
    await browser.ask('trocarShown.stopAt(trocarShown.frames.findIndex(f => f.contacts.length > 0 && f.inspection.constraints > 0))');
    const titles = await browser.ask(`[...document.querySelectorAll('#player h3')].map(h => h.textContent)`);
    expect(['Stage by stage', 'Candidate pairs', 'Constraints that push most', 'Islands'].every(t => titles.includes(t)), `stages, pairs, constraints, islands: ${titles}`);
    const row = name => browser.ask(`+[...document.querySelectorAll('#player tr')].find(r => r.cells[0].textContent === '${name}').cells[1].textContent`);
    const found = await browser.ask('({...trocarShown.frames[trocarShown.at].inspection, contacts: trocarShown.frames[trocarShown.at].contactsFound})');
    expect(await row('candidate pairs of bodies') === found.pairs.found && await row('constraints') === found.constraints && await row('contacts') === found.contacts, 'the numbers are those of the capture');
    expect(found.pairs.rows.reduce((n, p) => n + p.contacts, 0) === found.contacts && found.pairs.rows.reduce((n, p) => n + p.constraints, 0) === found.constraints, 'contacts and constraints are those of the pairs');
    const before = (await browser.ask(kPixels)).sum;
    await browser.ask(`document.querySelectorAll('#player .choices')[0].rows[0].click()`);
    expect(await browser.ask(`trocarShown.view.mark.geometry.attributes.position.count === trocarShown.frames[trocarShown.at].contacts.length && trocarShown.view.boxes.visible`), 'a click on a pair marks its contacts and boxes');
    expect((await browser.ask(kPixels)).sum !== before, 'which can be seen');
    await browser.ask(`document.querySelectorAll('#player .choices')[1].rows[0].click()`);
    expect(await browser.ask(`document.querySelector('#player h3').textContent`) === 'Contact', 'one on a constraint tells of its contact');
    await browser.ask(`document.querySelectorAll('#player .choices')[2].rows[0].click()`);
    expect(/^Island \d+$/.test(await browser.ask(`document.querySelector('#player h3').textContent`)), 'one on an island tells its bodies');
}

// Liquid and drops of a scene that bleeds are drawn, and go with their layer.
async function checkEffects(browser) {
    expect(await browser.until(`typeof trocarShown === 'object'`), 'the player of a wet scene starts');
    await browser.ask('trocarShown.stopAt(trocarShown.frames.length - 1)');
    const {films, drops} = await browser.ask(`(e => ({films: e.films.size, drops: e.balls.length}))(trocarShown.frames.at(-1).effects)`);
    expect(films > 0 && drops > 0, `${films} wet bodies, ${drops} drops`);
    const red = `(() => {
        const {renderer, scene, camera} = trocarShown.view, gl = renderer.getContext();
        renderer.render(scene, camera);
        const pixels = new Uint8Array(4 * gl.drawingBufferWidth * gl.drawingBufferHeight);
        gl.readPixels(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
        let count = 0;
        for (let i = 0; i < pixels.length; i += 4) count += pixels[i] > 60 && pixels[i + 1] < 0.25 * pixels[i] && pixels[i + 2] < 0.25 * pixels[i];
        return count;
    })()`;
    const wet = await browser.ask(red);
    await browser.ask(`[...document.querySelectorAll('#player label')].find(l => /threads and fluids/.test(l.textContent)).querySelector('input').click()`);
    const dry = await browser.ask(red);
    expect(wet > 300 && dry < wet / 10, `blood is red: ${wet} pixels, ${dry} without the layer`);
}

async function main() {
    let page = givenPage;
    if (!page) {
        page = join(folder, 'run', 'report.html');
        execFileSync(program, ['run', 'probe_on_liver', '--seconds', '1.2', '--no-render', '--set', 'liver.triangles=1500', '--set', 'probe.triangles=300',
            '--capture', '60-66', '--out', join(folder, 'run')], {stdio: 'ignore'});
        if (!readFileSync(page, 'utf8').includes('id="player-recording"')) {
            console.log('skipped: the program was built without the player');
            return kSkipped;
        }
    }
    const browser = new Browser();
    try {
        await browser.open('file://' + page);
        expect(await browser.until(`typeof trocarShown === 'object'`), 'the player starts');
        if (!givenPage) await checkPlaces(browser, join(folder, 'run')), await checkPlots(browser);
        await checkUse(browser);
        if (!givenPage) {
            execFileSync(program, ['capture', 'export', join(folder, 'run/captures/passes_60-66.cap'), '--html', join(folder, 'capture.html')], {stdio: 'ignore'});
            await browser.open('file://' + join(folder, 'capture.html'));
            await checkInspection(browser);
            execFileSync(program, ['run', 'bleed_and_suck', '--seconds', '2', '--no-render', '--set', 'liver.triangles=1500', '--set', 'bleeding=3000.0', '--out', join(folder, 'wet')], {stdio: 'ignore'});
            await browser.open('file://' + join(folder, 'wet', 'report.html'));
            await checkEffects(browser);
        }
        const requests = browser.heard.filter(m => m.method === 'Network.requestWillBeSent').map(m => m.params.request.url).filter(url => !/^(file|data|blob):/.test(url));
        expect(requests.length === 0, `nothing is asked of a network ${requests.join(' ')}`);
        expect(browser.errors.length === 0, `nothing is wrong in the console ${browser.errors.map(e => JSON.stringify(e.params)).join('\n')}`);
    } finally {
        await browser.close();
    }
    return 0;
}

end(main);
