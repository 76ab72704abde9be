// The surface as discs, coloured by what is captured. Form tells the same as colour: captured is full, missed is a ring, out of reach is a dot.

import { INSTANT_S } from './model.js';
import { COVERAGE } from './theme.js';
import { cross } from './structures.js';

export const DISC_MODES = { off: 0, now: 1, final: 2, difference: 3 };
// Larger discs would stand out over the edges of walls, m; where samples are far apart that matters less.
const WIDEST_M = 3;
const WIDEST_SHARE = 0.32;
// The two triangles of a square.
const SQUARE = [0, 1, 3, 0, 3, 2];

export class Discs {
    // Against another flight, if there is one; `sign` is -1 where this one is B.
    constructor(flight, other, sign) {
        const { surface, seen, captured, r, capturable, threshold } = flight.coverage;
        const { count } = surface;
        const spacing = Math.sqrt(Float32Array.from(surface.areas).sort()[count >> 1] ?? 1);
        const widest = Math.max(WIDEST_M, WIDEST_SHARE * spacing);
        const differences = other ? differenceBetween(flight, other) : null;
        // A square for each disc, out of which the fragment shader cuts its form: processors that draw by software have little to do for that.
        const [positions, facing, times, shares] = [3, 3, 2, 3].map((size) => new Float32Array(4 * size * count));
        const indices = new Uint32Array(6 * count);
        for (let k = 0; k < count; k += 1) {
            const radius = Math.min(Math.sqrt((0.75 * surface.areas[k]) / Math.PI), widest);
            const normal = surface.normals.subarray(3 * k, 3 * k + 3);
            const across = cross(normal, Math.abs(normal[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]);
            const length = Math.hypot(...across);
            const along = cross(normal, across);
            for (let c = 0; c < 4; c += 1) {
                const [u, v] = [(c & 1 ? radius : -radius) / length, (c & 2 ? radius : -radius) / length];
                for (let axis = 0; axis < 3; axis += 1) {
                    positions[3 * (4 * k + c) + axis] = surface.positions[3 * k + axis] + 0.12 * normal[axis] + u * across[axis] + v * along[axis];
                }
                const corner = 4 * k + c;
                for (let axis = 0; axis < 3; axis += 1) facing[3 * corner + axis] = normal[axis];
                [times[2 * corner], times[2 * corner + 1]] = [seen[k], captured[k]];
                shares[3 * corner] = Math.min(r[k] / Math.max(threshold, 1e-6), 1);
                [shares[3 * corner + 1], shares[3 * corner + 2]] = [capturable[k], differences ? sign * differences[k] : 0];
            }
            for (let c = 0; c < 6; c += 1) indices[6 * k + c] = 4 * k + SQUARE[c];
        }
        const geometry = new THREE.BufferGeometry();
        const each = (name, values, size) => geometry.setAttribute(name, new THREE.BufferAttribute(values, size));
        each('position', positions, 3);
        each('facing', facing, 3);
        each('times', times, 2);
        each('shares', shares, 3);
        geometry.setIndex(new THREE.BufferAttribute(indices, 1));
        this.material = new THREE.ShaderMaterial({
            side: THREE.DoubleSide,
            polygonOffset: true,
            polygonOffsetFactor: -1,
            polygonOffsetUnits: -2,
            uniforms: {
                mode: { value: 0 },
                now: { value: 0 },
                waiting: { value: new THREE.Vector3() },
                ...Object.fromEntries(Object.entries(COVERAGE).map(([name, colour]) => [name, { value: new THREE.Vector3(...colour) }])),
            },
            vertexShader: `
                attribute vec3 facing; attribute vec2 times; attribute vec3 shares;
                uniform int mode; uniform float now;
                uniform vec3 waiting; uniform vec3 captured; uniform vec3 nothing; uniform vec3 halfway; uniform vec3 beyond; uniform vec3 gained; uniform vec3 lost;
                flat varying vec3 colour;
                // Squares of the inner and the outer radius, in radii of the disc.
                flat varying vec2 ring;
                varying vec2 spot;
                void main() {
                    spot = vec2((gl_VertexID & 1) == 0 ? -1.0 : 1.0, (gl_VertexID & 2) == 0 ? -1.0 : 1.0);
                    if (dot(facing, cameraPosition - position) <= 0.0) {
                        gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
                        return;
                    }
                    bool isCaptured = times.y >= 0.0 && (mode == 2 || times.y <= now);
                    bool isSeen = times.x >= 0.0 && times.x <= now;
                    if (mode == 3) {
                        colour = shares.z > 0.5 ? gained : shares.z < -0.5 ? lost : waiting;
                        ring = shares.z > 0.5 ? vec2(0.0, 1.0) : shares.z < -0.5 ? vec2(0.25, 1.0) : vec2(0.0, 0.07);
                    } else if (isCaptured) {
                        colour = captured;
                        ring = vec2(0.0, 1.0);
                    } else if (shares.y < 0.5) {
                        colour = beyond;
                        ring = vec2(0.0, 0.14);
                    } else if (mode == 2) {
                        colour = mix(nothing, halfway, shares.x);
                        ring = vec2(0.25, 1.0);
                    } else if (isSeen) {
                        colour = halfway * vec3(1.0, 0.86, 0.6);
                        ring = vec2(0.25, 1.0);
                    } else {
                        colour = waiting;
                        ring = vec2(0.34, 0.62);
                    }
                    gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
                }`,
            fragmentShader: `
                flat varying vec3 colour; flat varying vec2 ring; varying vec2 spot;
                void main() {
                    float square = dot(spot, spot);
                    if (square < ring.x || square > ring.y) discard;
                    gl_FragColor = vec4(colour, 1.0);
                }`,
        });
        this.mesh = new THREE.Mesh(geometry, this.material);
        this.mesh.frustumCulled = false;
    }

    show(mode, now) {
        this.material.uniforms.mode.value = DISC_MODES[mode];
        this.material.uniforms.now.value = now + INSTANT_S;
        this.mesh.visible = mode !== 'off';
    }

    paint(colours) {
        this.material.uniforms.waiting.value.set(...colours.waiting);
    }
}

// A sample's place to a quarter of a metre, and where it looks: the two sides of a sheet have samples at the same places.
function keyOf({ positions, normals }, k) {
    const place = [0, 1, 2].map((axis) => Math.round(4 * positions[3 * k + axis]));
    return [...place, ...[0, 1, 2].map((axis) => Math.round(4 * normals[3 * k + axis]))].join();
}

// By sample of the first flight: 1 where only this one captures it, -1 where only the other one does. Samples that the other one does not have are new.
export function differenceBetween(flight, other) {
    const [mine, theirs] = [flight.coverage, other.coverage];
    const differences = new Int8Array(mine.surface.count);
    let twin = (k) => k;
    if (mine.surface !== theirs.surface) {
        const places = new Map();
        for (let k = 0; k < theirs.surface.count; k += 1) places.set(keyOf(theirs.surface, k), k);
        twin = (k) => places.get(keyOf(mine.surface, k));
    }
    for (let k = 0; k < differences.length; k += 1) differences[k] = Number(mine.captured[k] >= 0) - Number(theirs.captured[twin(k)] >= 0);
    return differences;
}
