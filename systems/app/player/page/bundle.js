// node bundle.js OUT.cpp: writes main.js and what it imports as one C++ file (see player_bundle.hpp).
import {build} from 'esbuild';
import {readFileSync, writeFileSync} from 'node:fs';
import {deflateSync} from 'node:zlib';

const result = await build({entryPoints: ['main.js'], bundle: true, minify: true, write: false, format: 'iife', target: 'es2022',
                            legalComments: 'none'});
const base64 = deflateSync(result.outputFiles[0].contents, {level: 9}).toString('base64');
const lines = base64.match(/.{1,4000}/g).map(line => `    "${line}"\n`).join('');
const licence = readFileSync('node_modules/three/LICENSE', 'utf8');
writeFileSync(process.argv[2], `#include "systems/app/player/player_bundle.hpp"
namespace trocar {
const char* const kPlayerScript =
${lines};
const char* const kPlayerLicences = R"licence(${licence})licence";
}  // namespace trocar
`);
