#pragma once
namespace trocar {

// Script of a page with plots: the values under the pointer, a line at the time that the player shows, a click that goes to a
// time (events `trocar-shown` and `trocar-time`, see systems/app/player/page/main.js), and the list of contents.
inline constexpr const char* kPlotCursor = R"js(
(() => {
const numbers = text => text.split(' ').map(Number);
const tip = Object.assign(document.createElement('div'), {className: 'tip'});
document.body.append(tip);
const goTo = time => document.dispatchEvent(new CustomEvent('trocar-time', {detail: time}));
const nearest = (points, x) => points.reduce((best, p) => Math.abs(p[0] - x) < Math.abs(best[0] - x) ? p : best);
const verticalLine = (svg, name, top, bottom) => {
    const line = document.createElementNS('http://www.w3.org/2000/svg', 'line');
    line.setAttribute('class', name), line.setAttribute('y1', top), line.setAttribute('y2', bottom), line.style.display = 'none';
    return svg.appendChild(line);
};
const put = (line, x) => { line.setAttribute('x1', x), line.setAttribute('x2', x), line.style.display = ''; };
const short = v => Math.abs(v) >= 1e5 || (v !== 0 && Math.abs(v) < 1e-3) ? v.toExponential(2) : String(+v.toPrecision(4));

for (const svg of document.querySelectorAll('svg[data-plot]')) {
    const [left, right, top, bottom, x0, x1, y0, y1] = numbers(svg.dataset.plot), {unit = '', over = '', times} = svg.dataset;
    const eventTimes = times ? numbers(times) : null, isLog = 'log' in svg.dataset, width = svg.viewBox.baseVal.width;
    const lines = [...svg.querySelectorAll('polyline')].map(line => ({name: line.dataset.name, colour: line.getAttribute('stroke'),
        points: line.getAttribute('points').trim().split(' ').map(p => p.split(',').map(Number))}));
    const valueX = x => { const v = x0 + (x - left) / (right - left) * (x1 - x0); return isLog ? 10 ** v : v; };
    const valueY = y => y0 + (bottom - y) / (bottom - top) * (y1 - y0);
    const timeAt = x => eventTimes ? eventTimes[Math.min(eventTimes.length, Math.max(1, Math.round(valueX(x)))) - 1] : 'time' in svg.dataset ? valueX(x) : null;
    const cursor = verticalLine(svg, 'cursor', top, bottom), shown = verticalLine(svg, 'shown', top, bottom);
    const placeOf = e => { const box = svg.getBoundingClientRect(); return [e.clientX - box.left, e.clientY - box.top].map(p => p / box.width * width); };
    // The point of a curve that a click is close to, such as a peak; else the place itself.
    const meantBy = (x, y) => lines.flatMap(l => l.points).reduce((best, p) => {
        const away = Math.hypot(p[0] - x, p[1] - y);
        return away < best.away ? {away, x: p[0]} : best;
    }, {away: 8, x}).x;
    const hide = () => { tip.style.display = cursor.style.display = 'none'; };
    svg.addEventListener('pointerleave', hide);
    svg.addEventListener('pointermove', e => {
        const [x] = placeOf(e);
        if (x < left || x > right) return hide();
        put(cursor, x);
        const [name, unitX = ''] = over.split(', ');
        tip.replaceChildren(`${name}: ${short(valueX(x))} ${unitX.length < 8 ? unitX : ''}${eventTimes ? `, at ${short(timeAt(x))} s` : ''}`);
        for (const {name, colour, points} of lines) {
            const row = document.createElement('div');
            row.style.color = colour, row.textContent = `${name}: ${short(valueY(nearest(points, x)[1]))} ${unit}`;
            tip.append(row);
        }
        tip.style.display = 'block';
        tip.style.left = `${Math.min(e.clientX + 14, innerWidth - tip.offsetWidth - 8)}px`, tip.style.top = `${e.clientY + 14}px`;
    });
    if (timeAt(left) === null) continue;
    svg.classList.add('timed');
    svg.addEventListener('click', e => { const [x, y] = placeOf(e); if (x >= left && x <= right) goTo(timeAt(meantBy(x, y))); });
    document.addEventListener('trocar-shown', e => {
        const after = eventTimes ? eventTimes.findIndex(t => t >= e.detail) : 0;
        const v = eventTimes ? (after < 0 ? eventTimes.length : after + 1) : e.detail;
        put(shown, Math.min(right, Math.max(left, left + (v - x0) / (x1 - x0) * (right - left))));
    });
}
for (const card of document.querySelectorAll('.card[data-time]')) card.addEventListener('click', () => goTo(Number(card.dataset.time)));
if (document.getElementById('player')) document.body.classList.add('played');

const headings = [...document.querySelectorAll('h2')], contents = document.createElement('nav');
headings.forEach((h, i) => {
    h.id = h.id || `part${i}`;
    contents.append(Object.assign(document.createElement('a'), {href: `#${h.id}`, textContent: h.textContent}));
});
if (headings.length > 2) document.querySelector('h1 + p')?.after(contents);
})();
)js";

}  // namespace trocar
