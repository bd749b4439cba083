// The script of a page: trocarPlayer(element, bytes) builds the player of a recording; an element with `data-live` gets a live view.
import {readRecording} from './data.js';
import {startLive} from './live.js';
import {Player} from './player.js';

const live = document.querySelector('#player[data-live]');
if (live) startLive(live);

globalThis.trocarPlayer = (host, bytes) => {
    const recording = readRecording(bytes);
    globalThis.trocarRecording = recording;  // for scripts
    if (!document.createElement('canvas').getContext('webgl2')) throw new Error('it has no WebGL 2');
    return globalThis.trocarShown = new Player(host, recording);
};
