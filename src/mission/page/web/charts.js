// Speed, altitude and coverage over time, one below the other over one axis.

import { capturedPercent, clockText, droneAt } from './model.js';

const SVG = 'http://www.w3.org/2000/svg';
const ROW = { height: 40, gap: 9, top: 14 };
const GUTTER = { left: 96, right: 62 };
// Pieces of time of which no more is drawn than a line can show.
const PIECES = 700;

function element(name, attributes, ...children) {
    const made = document.createElementNS(SVG, name);
    Object.entries(attributes).forEach(([key, value]) => made.setAttribute(key, value));
    made.append(...children);
    return made;
}

// Values over time, thinned so that of each piece of time the first, the least, the greatest and the last stay.
function thinned(times, values) {
    if (times.length <= 2 * PIECES) return Array.from(times, (time, k) => [time, values[k]]);
    const points = [];
    const length = times[times.length - 1] / PIECES || 1;
    for (let from = 0; from < times.length; ) {
        const piece = Math.floor(times[from] / length);
        let [low, high, to] = [from, from, from + 1];
        for (; to < times.length && Math.floor(times[to] / length) === piece; to += 1) {
            if (values[to] < values[low]) low = to;
            if (values[to] > values[high]) high = to;
        }
        const kept = [...new Set([from, low, high, to - 1])].sort((a, b) => a - b);
        points.push(...kept.map((k) => [times[k], values[k]]));
        from = to;
    }
    return points;
}

const SERIES = [
    { key: 'speed', title: 'Speed', unit: 'm/s', digits: 1, of: ({ path }) => thinned(path.times, path.speeds), at: (flight, time) => droneAt(flight, time).speed },
    {
        key: 'altitude',
        title: 'Height',
        unit: 'm',
        digits: 0,
        of: ({ path }) => thinned(path.times, path.positions.filter((_, k) => k % 3 === 2)),
        at: (flight, time) => droneAt(flight, time).position[2],
    },
    {
        key: 'coverage',
        title: 'Captured',
        unit: '%',
        digits: 1,
        most: 100,
        of: (flight) => {
            if (!flight.coverage) return [];
            const { times, capturable } = flight.coverage.curve;
            const percents = Float32Array.from(times, (_, k) => (100 * (k + 1)) / capturable);
            return [[0, 0], ...thinned(times, percents), [flight.duration_s, capturedPercent(flight, flight.duration_s)]];
        },
        at: capturedPercent,
    },
];

export class Charts {
    constructor(svg, onJump) {
        this.svg = svg;
        this.onJump = onJump;
        svg.addEventListener('pointerdown', (event) => {
            svg.setPointerCapture(event.pointerId);
            this.isHeld = true;
            this.jump(event);
        });
        svg.addEventListener('pointermove', (event) => this.isHeld && this.jump(event));
        ['pointerup', 'pointercancel'].forEach((end) => svg.addEventListener(end, () => { this.isHeld = false; }));
        new ResizeObserver(() => this.draw()).observe(svg);
    }

    jump(event) {
        if (!this.flights) return;
        const x = event.clientX - this.svg.getBoundingClientRect().left;
        this.onJump(Math.min(Math.max((x - GUTTER.left) / this.inner, 0), 1) * this.duration);
    }

    show(flights, duration) {
        [this.flights, this.duration] = [flights, Math.max(duration, 1e-6)];
        this.draw();
    }

    x(time) {
        return GUTTER.left + (Math.min(time, this.duration) / this.duration) * this.inner;
    }

    draw() {
        if (!this.flights) return;
        const width = this.svg.clientWidth;
        this.inner = Math.max(width - GUTTER.left - GUTTER.right, 10);
        const height = ROW.top + SERIES.length * (ROW.height + ROW.gap) + 12;
        this.svg.setAttribute('viewBox', `0 0 ${Math.max(width, 1)} ${height}`);
        this.svg.style.height = `${height}px`;
        this.readings = [];
        const rows = SERIES.map((series, index) => this.row(series, ROW.top + index * (ROW.height + ROW.gap)));
        const bottom = ROW.top + SERIES.length * (ROW.height + ROW.gap) - ROW.gap;
        this.cursor = element('line', { class: 'cursor', y1: ROW.top, y2: bottom });
        this.svg.replaceChildren(element('title', {}, 'Speed, height and captured share over the time of the flight'), this.batteries(bottom), ...rows, this.axis(bottom), this.cursor);
        this.follow(this.time ?? 0);
    }

    row({ title, unit, digits, most, of, at }, top) {
        const lines = this.flights.map(of);
        const highest = most ?? Math.max(1e-6, ...lines.flat().map((point) => point[1])) * 1.06;
        const y = (value) => top + ROW.height * (1 - Math.max(value, 0) / highest);
        const row = element('g', {});
        const under = title === 'Height' && this.flights[0].scene.terrain ? 'm over lowest' : unit;
        row.append(element('line', { class: 'base', x1: GUTTER.left, x2: GUTTER.left + this.inner, y1: top + ROW.height, y2: top + ROW.height }));
        row.append(element('text', { class: 'title', x: 0, y: top + 14 }, title));
        row.append(element('text', { class: 'unit', x: 0, y: top + 29 }, under));
        row.append(element('text', { class: 'tick', x: GUTTER.left - 7, y: top + 8 }, highest.toFixed(0)));
        row.append(element('text', { class: 'tick', x: GUTTER.left - 7, y: top + ROW.height }, '0'));
        const goal = this.flights[0].goal_percent;
        if (most && goal) row.append(element('line', { class: 'goal', x1: GUTTER.left, x2: GUTTER.left + this.inner, y1: y(goal), y2: y(goal) }));
        lines.forEach((points, k) => {
            if (points.length === 0) return;
            const d = points.map(([time, value], p) => `${p === 0 ? 'M' : 'L'}${this.x(time).toFixed(1)} ${y(value).toFixed(1)}`).join('');
            const last = points[points.length - 1][0];
            if (k === 0) row.append(element('path', { class: 'area', d: `${d}L${this.x(last).toFixed(1)} ${top + ROW.height}L${GUTTER.left} ${top + ROW.height}Z` }));
            row.append(element('path', { class: k === 0 ? 'line' : 'line other', d }));
        });
        this.flights.forEach((flight, k) => {
            const text = element('text', { class: k === 0 ? 'reading' : 'reading other', x: GUTTER.left + this.inner + 8, y: top + 15 + 17 * k });
            this.readings.push({ text, write: (time) => (at(flight, time)?.toFixed(digits) ?? '–') });
            row.append(text);
        });
        return row;
    }

    batteries(bottom) {
        const { sorties } = this.flights[0];
        const marks = sorties.length > 1 ? sorties : [];
        return element('g', { class: 'sorties' }, ...marks.flatMap(({ number, start_s: start, end_s: end }) => {
            const [from, to] = [this.x(start), this.x(end)];
            const band = element('rect', { class: number % 2 === 0 ? 'even' : 'odd', x: from, y: ROW.top, width: Math.max(to - from, 0), height: bottom - ROW.top });
            const name = to - from > 44 ? [element('text', { class: 'battery', x: (from + to) / 2, y: ROW.top - 4 }, `sortie ${number}`)] : [];
            return [band, ...name];
        }));
    }

    axis(bottom) {
        const steps = [10, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200, 14_400];
        const least = this.duration / Math.max(this.inner / 90, 2);
        const step = steps.find((one) => one >= least) ?? 28_800 * 2 ** Math.max(0, Math.ceil(Math.log2(least / 28_800)));
        const times = Array.from({ length: Math.floor(this.duration / step) + 1 }, (_, k) => k * step);
        return element('g', {}, ...times.map((time) => element('text', { class: 'time', x: this.x(time), y: bottom + 13 }, clockText(time))));
    }

    follow(time) {
        this.time = time;
        if (!this.cursor) return;
        const x = this.x(time).toFixed(1);
        this.cursor.setAttribute('x1', x);
        this.cursor.setAttribute('x2', x);
        this.readings.forEach(({ text, write }) => { text.textContent = write(time); });
    }
}
