// The surface as discs, coloured by what is captured. Form tells the same as colour: captured is full, missed is a ring, out of reach is a dot.

export const DISC_MODES = { off: 0, now: 1, final: 2, difference: 3 };
// Larger discs would stand out over the edges of walls, m.
const WIDEST_M = 2.6;
const CORNERS = 8;

export class Discs {
    constructor(flight, other) {
        const { surface, seen, captured, r, capturable, threshold } = flight.coverage;
        const geometry = new THREE.InstancedBufferGeometry();
        geometry.instanceCount = surface.count;
        const corners = [];
        for (let k = 0; k < CORNERS; k += 1) {
            const [a, b] = [k, k + 1].map((step) => (2 * Math.PI * step) / CORNERS);
            corners.push(0, 0, 0, Math.cos(a), Math.sin(a), 0, Math.cos(b), Math.sin(b), 0);
        }
        geometry.setAttribute('position', new THREE.Float32BufferAttribute(corners, 3));
        const each = (name, values, size) => geometry.setAttribute(name, new THREE.InstancedBufferAttribute(values, size));
        each('place', surface.positions, 3);
        each('facing', surface.normals, 3);
        each('radius', surface.areas.map((area) => Math.min(Math.sqrt((0.62 * area) / Math.PI), WIDEST_M)), 1);
        const times = new Float32Array(2 * surface.count);
        const shares = new Float32Array(3 * surface.count);
        const differences = other ? differenceBetween(flight, other) : null;
        for (let k = 0; k < surface.count; k += 1) {
            times.set([seen[k], captured[k]], 2 * k);
            shares.set([Math.min(r[k] / Math.max(threshold, 1e-6), 1), capturable[k], differences ? differences[k] : 0], 3 * k);
        }
        each('times', times, 2);
        each('shares', shares, 3);
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
                attribute vec3 place; attribute vec3 facing; attribute float radius; attribute vec2 times; attribute vec3 shares;
                uniform int mode; uniform float now;
                uniform vec3 waiting; uniform vec3 captured; uniform vec3 nothing; uniform vec3 halfway; uniform vec3 beyond; uniform vec3 gained; uniform vec3 lost;
                varying vec3 colour; varying float hole; varying vec2 spot;
                void main() {
                    float size = radius;
                    hole = 0.0;
                    bool isCaptured = times.y >= 0.0 && (mode == 2 || times.y <= now);
                    bool isSeen = times.x >= 0.0 && times.x <= now;
                    if (mode == 3) {
                        colour = shares.z > 0.5 ? gained : shares.z < -0.5 ? lost : waiting;
                        hole = shares.z > 0.5 ? 0.0 : shares.z < -0.5 ? 0.5 : 0.8;
                        if (abs(shares.z) < 0.5) size *= 0.4;
                    } else if (isCaptured) {
                        colour = captured;
                    } else if (shares.y < 0.5) {
                        colour = beyond;
                        size *= 0.42;
                    } else if (mode == 2) {
                        colour = mix(nothing, halfway, shares.x);
                        hole = 0.5;
                    } else if (isSeen) {
                        colour = halfway * vec3(1.0, 0.86, 0.6);
                        hole = 0.5;
                    } else {
                        colour = waiting;
                        hole = 0.72;
                        size *= 0.8;
                    }
                    vec3 helper = abs(facing.z) < 0.9 ? vec3(0.0, 0.0, 1.0) : vec3(1.0, 0.0, 0.0);
                    vec3 across = normalize(cross(facing, helper));
                    vec3 along = cross(facing, across);
                    spot = position.xy;
                    vec3 corner = place + facing * 0.12 + size * (across * position.x + along * position.y);
                    gl_Position = projectionMatrix * modelViewMatrix * vec4(corner, 1.0);
                }`,
            fragmentShader: `
                varying vec3 colour; varying float hole; varying vec2 spot;
                void main() { if (length(spot) < hole) discard; gl_FragColor = vec4(colour, 1.0); }`,
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
        this.material.uniforms.waiting.value.set(...colours.grid.map((value) => value * 0.9));
    }
}

// Places of samples to a quarter of a metre: samples of two fields that lie there are the same.
const placeOf = (positions, k) => `${Math.round(4 * positions[3 * k])},${Math.round(4 * positions[3 * k + 1])},${Math.round(4 * positions[3 * k + 2])}`;

// By sample of the first flight: 1 where only this one captures it, -1 where only the other one does. Samples that the other one does not have are new.
export function differenceBetween(flight, other) {
    const theirs = new Map();
    const surface = other.coverage.surface;
    for (let k = 0; k < surface.count; k += 1) theirs.set(placeOf(surface.positions, k), other.coverage.captured[k] >= 0);
    const mine = flight.coverage;
    const differences = new Int8Array(mine.surface.count);
    for (let k = 0; k < mine.surface.count; k += 1) {
        const isCaptured = mine.captured[k] >= 0;
        const was = theirs.get(placeOf(mine.surface.positions, k));
        differences[k] = Number(isCaptured) - Number(was ?? false);
    }
    return differences;
}
