// node mcap_check.js PROGRAM FOLDER: records an exercise, exports it as MCAP and reads it back with the format's own library,
// which npm loads into FOLDER; exit code 1 if something is wrong, 77 (skipped) where npm cannot load it.
const {execFileSync, spawnSync} = require('node:child_process');
const {existsSync, mkdirSync, readFileSync, rmSync, writeFileSync} = require('node:fs');
const {join} = require('node:path');

const kSkipped = 77, kLibrary = '@mcap/core@2.2.2';
const [program, folder] = process.argv.slice(2);
mkdirSync(folder, {recursive: true});
if (!existsSync(join(folder, 'node_modules', '@mcap', 'core'))) {
    writeFileSync(join(folder, 'package.json'), '{"private": true}');
    const loaded = spawnSync('npm', ['install', '--ignore-scripts', '--no-audit', '--no-fund', '--prefer-offline', '--fetch-retries=1',
        '--fetch-retry-mintimeout=1000', '--fetch-timeout=20000', kLibrary], {cwd: folder, timeout: 120_000});
    if (loaded.status !== 0) {
        console.log(`skipped: npm does not load ${kLibrary}`);
        process.exit(kSkipped);
    }
}
const {McapIndexedReader, McapStreamReader} = require(join(folder, 'node_modules', '@mcap', 'core'));
let failures = 0;
const expect = (holds, what) => {
    if (!holds) ++failures;
    console.log(`${holds ? 'ok    ' : 'FAILED'} ${what}`);
};

(async () => {
    const run = join(folder, 'run'), file = join(folder, 'exercise.mcap');
    rmSync(run, {recursive: true, force: true});
    // enough samples for two chunks of 1 MiB
    execFileSync(program, ['run', 'probe_on_liver', '--seconds', '1', '--no-render', '--set', 'liver.triangles=600', '--set', 'probe.triangles=300', '--out', run]);
    const [head, ...rows] = readFileSync(join(run, 'exercise.csv'), 'utf8').trim().split('\n').map(line => line.split(','));
    const many = [];
    for (let k = 0; k < 80; ++k) for (const row of rows) many.push([(k * 2 + Number(row[0])).toFixed(3), ...row.slice(1)].join(','));
    mkdirSync(join(folder, 'long'), {recursive: true});
    writeFileSync(join(folder, 'long', 'exercise.csv'), [head.join(','), ...many].join('\n') + '\n');
    for (const [from, lines] of [[run, rows.map(r => r.join(','))], [join(folder, 'long', 'exercise.csv'), many]]) {
        execFileSync(program, ['exercise', from, '--mcap', file]);
        const bytes = readFileSync(file);
        const reader = await McapIndexedReader.Initialize({readable: {
            size: async () => BigInt(bytes.length),
            read: async (offset, length) => new Uint8Array(bytes.subarray(Number(offset), Number(offset + length)))
        }});
        const topics = [...reader.channelsById.values()].map(c => c.topic).sort();
        expect(JSON.stringify(topics) === '["/events","/tool/probe"]', `topics ${topics}`);
        const samples = [], events = [];
        for await (const m of reader.readMessages({validateCrcs: true})) {
            const value = JSON.parse(new TextDecoder().decode(m.data));
            (reader.channelsById.get(m.channelId).topic === '/events' ? events : samples).push(value);
            if (Math.abs(Number(m.logTime) * 1e-9 - value.time_s) > 1e-8) expect(false, `time of a message: ${m.logTime}, ${value.time_s}`);
        }
        expect(samples.length === lines.length, `${samples.length} samples, ${lines.length} lines`);
        expect(Number(reader.statistics.messageCount) === samples.length + events.length, 'statistics count them');
        expect(events.length > 0 && events[0].event === 'touch', `${events.length} events`);
        expect(lines.every((line, i) => Math.abs(Number(line.split(',')[2]) - samples[i].tip_m.x) < 1e-9 &&
            Math.abs(Number(line.split(',')[17]) - samples[i].hand_peak_n) < 1e-8), 'places and forces are those of the CSV');
        if (from !== run) expect(reader.chunkIndexes.length > 1, `${reader.chunkIndexes.length} chunks`);
        // the whole file as a stream, with every checksum
        const stream = new McapStreamReader({validateCrcs: true});
        stream.append(bytes);
        let messages = 0;
        for (let record; (record = stream.nextRecord()) !== undefined;) messages += record.type === 'Message';
        expect(stream.done() && messages === samples.length + events.length, 'read as a stream to its end');
        // a damaged byte inside the first chunk is found
        const damaged = Buffer.from(bytes);
        damaged[bytes.indexOf('"tip_m":{"x"') + 2] ^= 1;
        let found = false;
        try {
            const bad = new McapStreamReader({validateCrcs: true});
            bad.append(damaged);
            while (bad.nextRecord() !== undefined) ;
        } catch { found = true; }
        expect(found, 'a damaged byte is found by the checksums');
    }
    process.exit(failures ? 1 : 0);
})().catch(error => { console.log(error); process.exit(1); });
