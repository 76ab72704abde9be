// The page's data, unpacked, and what follows from them. Metres east, north, up; seconds since the start of the flight.

const FORMAT = 'overfly-page/1';

function bytesOf(text) {
    const raw = atob(text);
    const bytes = new Uint8Array(raw.length);
    for (let k = 0; k < raw.length; k += 1) bytes[k] = raw.charCodeAt(k);
    return bytes;
}

const floats = (text) => new Float32Array(bytesOf(text).buffer);
const wholes = (text) => new Uint32Array(bytesOf(text).buffer);

// What is the same as in the model `before` is taken over, so that what was made of it stays.
export function modelOf(data, before) {
    if (data.format !== FORMAT) throw new Error(`the page's data are in the format ${data.format}, this page shows ${FORMAT}`);
    const known = before?.scenes ?? [];
    const scenes = data.scenes.map((scene) => known.find(({ raw }) => isSame(raw, scene)) ?? sceneOf(scene));
    const surfaces = data.surfaces.map((surface) => ({
        count: surface.count,
        positions: floats(surface.positions_m),
        normals: Float32Array.from(new Int8Array(bytesOf(surface.normals).buffer), (step) => step / 127),
        areas: floats(surface.areas_m2),
        structures: wholes(surface.structures),
    }));
    const flights = data.flights.map((flight) => flightOf(flight, scenes, surfaces));
    return { scenes, flights, version: data.version };
}

// Whether two scenes look the same, of whatever revision they are.
function isSame(one, other) {
    const text = (value) => (typeof value === 'string' ? value : JSON.stringify(value));
    return Object.keys(one).every((key) => key === 'revision' || text(one[key]) === text(other[key]));
}

function sceneOf(scene) {
    const corners = floats(scene.corners);
    const triangles = wholes(scene.triangles);
    let first = 0;
    const structures = scene.structures.map((structure, index) => {
        const box = boxOf(corners, triangles.subarray(3 * first, 3 * (first + structure.triangles)));
        const placed = { ...structure, index, first, count: structure.triangles, ...box };
        first += structure.triangles;
        return placed;
    });
    const zones = scene.zones.map((zone) => ({ ...zone, area: floats(zone.area) }));
    const ground = structures.find((one) => one.kind === 'terrain');
    const terrain = ground?.count > 0 ? ground : undefined;
    return { ...scene, raw: scene, corners, triangles, structures, zones, terrain };
}

export function boxOf(corners, indices) {
    const min = [Infinity, Infinity, Infinity];
    const max = [-Infinity, -Infinity, -Infinity];
    for (const corner of indices) {
        for (let axis = 0; axis < 3; axis += 1) {
            const value = corners[3 * corner + axis];
            if (value < min[axis]) min[axis] = value;
            if (value > max[axis]) max[axis] = value;
        }
    }
    return { min, max };
}

function flightOf(flight, scenes, surfaces) {
    const { path, images, coverage } = flight;
    const unpacked = {
        ...flight,
        scene: scenes[flight.scene],
        path: { count: path.count, times: floats(path.times_s), positions: floats(path.positions_m), speeds: floats(path.speeds_mps) },
        waypoints: floats(flight.waypoints_m),
        images: {
            count: images.count,
            times: floats(images.times_s),
            positions: floats(images.positions_m),
            directions: floats(images.directions),
            ups: floats(images.ups),
            cameras: bytesOf(images.cameras),
            selected: bytesOf(images.selected),
        },
        coverage: coverage && {
            by: coverage.by,
            knowsBefore: coverage.knows_before,
            threshold: coverage.threshold_percent,
            seen: floats(coverage.seen_s),
            captured: floats(coverage.captured_s),
            r: floats(coverage.r_percent),
            capturable: bytesOf(coverage.capturable),
            surface: surfaces[flight.surface],
        },
    };
    unpacked.bounds = pathBounds(unpacked.path);
    unpacked.fastest = unpacked.path.speeds.reduce((most, speed) => Math.max(most, speed), 0);
    if (unpacked.coverage) {
        unpacked.coverage.curve = curveOf(unpacked.coverage);
        unpacked.coverage.tallies = talliesOf(unpacked);
    }
    return unpacked;
}

function pathBounds({ positions }) {
    const min = [Infinity, Infinity, Infinity];
    const max = [-Infinity, -Infinity, -Infinity];
    for (let k = 0; k < positions.length; k += 1) {
        min[k % 3] = Math.min(min[k % 3], positions[k]);
        max[k % 3] = Math.max(max[k % 3], positions[k]);
    }
    return { min, max };
}

// When each of the samples that can be captured is captured, in order.
function curveOf(coverage) {
    const times = [];
    let capturable = 0;
    for (let k = 0; k < coverage.captured.length; k += 1) {
        if (coverage.capturable[k] !== 1) continue;
        capturable += 1;
        if (coverage.captured[k] >= 0) times.push(coverage.captured[k]);
    }
    return { times: Float32Array.from(times).sort(), capturable };
}

// Samples of each structure: all, those that can be captured, and of these those that are.
function talliesOf({ scene, coverage }) {
    const tallies = scene.structures.map(() => ({ exposed: 0, capturable: 0, captured: 0 }));
    coverage.surface.structures.forEach((structure, k) => {
        const tally = tallies[structure];
        if (!tally) return;
        tally.exposed += 1;
        if (coverage.capturable[k] !== 1) return;
        tally.capturable += 1;
        if (coverage.captured[k] >= 0) tally.captured += 1;
    });
    return tallies;
}

// Times have seven digits in the data.
export const INSTANT_S = 2e-3;

// How many of the ascending values are not above one.
export function countUpTo(ascending, value) {
    let [low, high] = [0, ascending.length];
    while (low < high) {
        const middle = (low + high) >> 1;
        if (ascending[middle] <= value) low = middle + 1;
        else high = middle;
    }
    return low;
}

// Share of what can be captured that is captured until then, percent.
export function capturedPercent(flight, time) {
    if (!flight.coverage) return null;
    const { times, capturable } = flight.coverage.curve;
    return capturable === 0 ? 100 : (100 * countUpTo(times, time + INSTANT_S)) / capturable;
}

// The drone at a time: where it is, how fast, and which way it goes.
export function droneAt({ path }, time) {
    const last = path.count - 1;
    const above = Math.min(Math.max(countUpTo(path.times, time), Math.min(1, last)), last);
    const below = Math.max(above - 1, 0);
    const span = path.times[above] - path.times[below];
    const share = span > 0 ? Math.min(Math.max((time - path.times[below]) / span, 0), 1) : 0;
    const at = (axis) => {
        const [from, to] = [path.positions[3 * below + axis], path.positions[3 * above + axis]];
        return from + (to - from) * share;
    };
    const way = [0, 1, 2].map((axis) => path.positions[3 * above + axis] - path.positions[3 * below + axis]);
    return {
        position: [at(0), at(1), at(2)],
        speed: path.speeds[below] + (path.speeds[above] - path.speeds[below]) * share,
        way,
    };
}

// Places along the path that are no farther apart than a step, m.
export function stepsAlong({ path: { count, positions } }, step) {
    const place = (k) => Array.from(positions.subarray(3 * k, 3 * k + 3));
    const places = count > 0 ? [place(0)] : [];
    for (let k = 0; k + 1 < count; k += 1) {
        const [from, to] = [place(k), place(k + 1)];
        const parts = Math.ceil(distanceOf(from, to) / step);
        for (let part = 1; part <= parts; part += 1) places.push(from.map((value, axis) => value + ((to[axis] - value) * part) / parts));
    }
    return places;
}

// The images of the last release of the shutter until a time; none before the first.
export function imagesAt({ images }, time) {
    const taken = countUpTo(images.times, time + INSTANT_S);
    if (taken === 0) return [];
    const released = images.times[taken - 1];
    const indices = [];
    for (let k = taken - 1; k >= 0 && images.times[k] === released; k -= 1) indices.push(k);
    return indices.reverse();
}

// Colours from a ramp of stops, each red, green, blue from 0 to 1.
export function rampColour(stops, share) {
    const place = Math.min(Math.max(share, 0), 1) * (stops.length - 1);
    const below = Math.min(Math.floor(place), stops.length - 2);
    return stops[below].map((from, channel) => from + (stops[below + 1][channel] - from) * (place - below));
}

export const distanceOf = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);

export const clockText = (seconds) => {
    const whole = Math.max(0, Math.round(seconds));
    const [hours, minutes, rest] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
    const two = (number) => String(number).padStart(2, '0');
    return hours > 0 ? `${hours}:${two(minutes)}:${two(rest)}` : `${minutes}:${two(rest)}`;
};

export const lengthText = (metres) => (Math.abs(metres) < 10_000 ? `${metres.toFixed(Math.abs(metres) < 100 ? 1 : 0)} m` : `${(metres / 1000).toFixed(1)} km`);
