// The structures of a scene as one mesh with baked light, their edges as one set of lines; and what a ray meets of them.

import { boxOf } from './model.js';

// From the south-west, as maps are lit. Each facade has a shade of its own.
const SUN = [-0.42, -0.62, 0.66];
// Walls are darker near the ground, m.
const DARK_FOOT_M = 12;
// Faces that meet at less than about 22 degrees are one face.
const FLAT_COSINE = 0.927;
// Triangles that are looked at together.
const BLOCK = 64;

export class Structures {
    constructor(scene) {
        this.scene = scene;
        this.group = new THREE.Group();
        this.tints = scene.structures.map(() => null);
        this.blocks = new Map();
        this.mesh = this.makeMesh();
        this.edges = this.makeEdges();
        this.group.add(this.mesh, this.edges);
    }

    makeMesh() {
        const { corners, triangles } = this.scene;
        const positions = new Float32Array(3 * triangles.length);
        this.normals = new Float32Array(triangles.length);
        for (let k = 0; k < triangles.length; k += 1) {
            for (let axis = 0; axis < 3; axis += 1) positions[3 * k + axis] = corners[3 * triangles[k] + axis];
        }
        for (let t = 0; t < triangles.length; t += 3) setNormal(this.normals, positions, t);
        const geometry = new THREE.BufferGeometry();
        geometry.setAttribute('position', new THREE.BufferAttribute(positions, 3));
        geometry.setAttribute('color', new THREE.BufferAttribute(new Uint8Array(3 * triangles.length), 3, true));
        const material = new THREE.MeshBasicMaterial({ vertexColors: true, side: THREE.DoubleSide, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 });
        const mesh = new THREE.Mesh(geometry, material);
        mesh.frustumCulled = false;
        return mesh;
    }

    makeEdges() {
        const { corners, triangles, structures } = this.scene;
        const lines = [];
        for (const { first, count, kind } of structures) {
            if (kind === 'terrain') continue;
            const known = new Map();
            for (let t = first; t < first + count; t += 1) {
                for (let c = 0; c < 3; c += 1) {
                    const [a, b] = [triangles[3 * t + c], triangles[3 * t + ((c + 1) % 3)]];
                    const key = a < b ? a * 16_777_216 + b : b * 16_777_216 + a;
                    const other = known.get(key);
                    if (other === undefined) known.set(key, t);
                    else if (other >= 0 && this.cosine(other, t) > FLAT_COSINE) known.set(key, -1);
                }
            }
            for (const [key, t] of known) {
                if (t < 0) continue;
                const [a, b] = [Math.floor(key / 16_777_216), key % 16_777_216];
                for (const corner of [a, b]) lines.push(corners[3 * corner], corners[3 * corner + 1], corners[3 * corner + 2]);
            }
        }
        const geometry = new THREE.BufferGeometry();
        geometry.setAttribute('position', new THREE.Float32BufferAttribute(lines, 3));
        const edges = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ transparent: true, depthWrite: false }));
        edges.frustumCulled = false;
        return edges;
    }

    cosine(s, t) {
        const n = this.normals;
        return Math.abs(n[3 * s] * n[3 * t] + n[3 * s + 1] * n[3 * t + 1] + n[3 * s + 2] * n[3 * t + 2]);
    }

    // A colour in place of a structure's own, or none.
    tint(index, colour) {
        if (this.tints[index] === colour) return;
        this.tints[index] = colour;
        this.bake(this.scene.structures[index]);
        this.mesh.geometry.attributes.color.needsUpdate = true;
    }

    paint(colours) {
        this.colours = colours;
        this.scene.structures.forEach((structure) => this.bake(structure));
        this.mesh.geometry.attributes.color.needsUpdate = true;
        this.edges.material.color.setRGB(...colours.edge, 'srgb');
        this.edges.material.opacity = colours.edgeOpacity;
    }

    bake({ index, first, count, kind, base_m: base }) {
        const own = kind === 'terrain' ? this.colours.terrain : kind === 'obstacle' ? this.colours.obstacle : this.colours.building;
        const colour = this.tints[index] ?? own;
        // Neighbours that touch are told apart.
        const shade = kind === 'structure' ? 0.97 + 0.03 * ((index * 7919) % 97) / 96 : 1;
        const bytes = this.mesh.geometry.attributes.color.array;
        const positions = this.mesh.geometry.attributes.position.array;
        for (let t = first; t < first + count; t += 1) {
            const [x, y, z] = [this.normals[3 * t], this.normals[3 * t + 1], this.normals[3 * t + 2]];
            const light = 0.66 + 0.26 * Math.max(0, x * SUN[0] + y * SUN[1] + z * SUN[2]) + 0.14 * Math.max(0, z);
            for (let k = 3 * t; k < 3 * t + 3; k += 1) {
                const above = Math.min(Math.max((positions[3 * k + 2] - base) / DARK_FOOT_M, 0), 1);
                const foot = kind === 'terrain' || z > 0.7 ? 1 : 0.84 + 0.16 * above;
                const strength = Math.min(light * foot * shade, 1.06) * (BYTES.length - 1);
                for (let c = 0; c < 3; c += 1) bytes[3 * k + c] = BYTES[Math.min(Math.round(colour[c] * strength), BYTES.length - 1)];
            }
        }
    }

    // The nearest triangle that a ray meets: where, and of which structure.
    meet(from, towards) {
        let nearest = null;
        for (const structure of this.scene.structures) {
            const distance = this.meetStructure(structure, from, towards, nearest?.distance ?? Infinity);
            if (distance !== null) nearest = { distance, structure };
        }
        return nearest && { ...nearest, point: from.map((value, axis) => value + towards[axis] * nearest.distance) };
    }

    // How far a ray goes to a structure, if it meets it within `farthest`.
    meetStructure(structure, from, towards, farthest) {
        if (structure.count === 0 || !meetsBox(from, towards, structure, farthest)) return null;
        let nearest = farthest;
        for (const block of this.blocksOf(structure)) {
            if (!meetsBox(from, towards, block, nearest)) continue;
            for (let t = block.first; t < block.end; t += 1) {
                const distance = this.meetTriangle(from, towards, t);
                if (distance !== null && distance < nearest) nearest = distance;
            }
        }
        return nearest < farthest ? nearest : null;
    }

    // How high the ground is below a place: that of the lowest place, 0, where nothing is known of it.
    groundAt([x, y]) {
        const { terrain } = this.scene;
        const above = terrain ? this.meetStructure(terrain, [x, y, terrain.max[2] + 1], [0, 0, -1], Infinity) : null;
        return above === null ? 0 : terrain.max[2] + 1 - above;
    }

    // A structure's triangles in blocks with a box each: most are passed over without a look at their triangles.
    blocksOf(structure) {
        if (this.blocks.has(structure)) return this.blocks.get(structure);
        const { corners, triangles } = this.scene;
        const blocks = [];
        const last = structure.first + structure.count;
        for (let first = structure.first; first < last; first += BLOCK) {
            const end = Math.min(first + BLOCK, last);
            blocks.push({ first, end, ...boxOf(corners, triangles.subarray(3 * first, 3 * end)) });
        }
        this.blocks.set(structure, blocks);
        return blocks;
    }

    // After Moeller and Trumbore, 1997.
    meetTriangle(from, towards, t) {
        const { corners, triangles } = this.scene;
        const [a, b, c] = [0, 1, 2].map((k) => 3 * triangles[3 * t + k]);
        const e1 = minus(corners, b, a);
        const e2 = minus(corners, c, a);
        const p = cross(towards, e2);
        const determinant = dot(e1, p);
        if (Math.abs(determinant) < 1e-12) return null;
        const s = [from[0] - corners[a], from[1] - corners[a + 1], from[2] - corners[a + 2]];
        const u = dot(s, p) / determinant;
        const q = cross(s, e1);
        const v = dot(towards, q) / determinant;
        const distance = dot(e2, q) / determinant;
        return u < 0 || v < 0 || u + v > 1 || distance < 1e-6 ? null : distance;
    }

    // How far a point is from a structure, m; `atMost` where it is not nearer than that.
    distanceTo(structure, point, atMost = Infinity) {
        const { corners, triangles } = this.scene;
        let least = atMost;
        const near = [];
        for (const block of this.blocksOf(structure)) {
            const atLeast = distanceToBox(point, block);
            if (atLeast < least) near.push([atLeast, block]);
        }
        near.sort((a, b) => a[0] - b[0]);
        for (const [atLeast, { first, end }] of near) {
            if (atLeast >= least) break;
            for (let t = first; t < end; t += 1) {
                const [a, b, c] = [0, 1, 2].map((k) => Array.from(corners.subarray(3 * triangles[3 * t + k], 3 * triangles[3 * t + k] + 3)));
                least = Math.min(least, distanceToTriangle(point, a, b, c));
            }
        }
        return least;
    }
}

// Colours of vertices are taken as linear light: for shares of the brightest the byte that stands for it.
const BYTES = Uint8Array.from({ length: 1025 }, (_, k) => {
    const value = k / 1024;
    return 255 * (value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4);
});

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const minus = (corners, b, a) => [corners[b] - corners[a], corners[b + 1] - corners[a + 1], corners[b + 2] - corners[a + 2]];

// The normal of the triangle that begins at corner `k` of the positions, at the same place.
function setNormal(normals, positions, k) {
    const p = 3 * k;
    const [ux, uy, uz] = [positions[p + 3] - positions[p], positions[p + 4] - positions[p + 1], positions[p + 5] - positions[p + 2]];
    const [vx, vy, vz] = [positions[p + 6] - positions[p], positions[p + 7] - positions[p + 1], positions[p + 8] - positions[p + 2]];
    const [x, y, z] = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    const length = Math.sqrt(x * x + y * y + z * z) || 1;
    [normals[k], normals[k + 1], normals[k + 2]] = [x / length, y / length, z / length];
}

function meetsBox(from, towards, { min, max }, farthest) {
    let [enter, leave] = [0, farthest];
    for (let axis = 0; axis < 3; axis += 1) {
        if (towards[axis] === 0) {
            if (from[axis] < min[axis] || from[axis] > max[axis]) return false;
            continue;
        }
        const inverse = 1 / towards[axis];
        const [near, far] = [(min[axis] - from[axis]) * inverse, (max[axis] - from[axis]) * inverse];
        enter = Math.max(enter, Math.min(near, far));
        leave = Math.min(leave, Math.max(near, far));
    }
    return enter <= leave;
}

export function distanceToBox(point, { min, max }) {
    let square = 0;
    for (let axis = 0; axis < 3; axis += 1) square += Math.max(min[axis] - point[axis], 0, point[axis] - max[axis]) ** 2;
    return Math.sqrt(square);
}

// After Ericson, Real-Time Collision Detection, 5.1.5.
function distanceToTriangle(p, a, b, c) {
    const sub = (u, v) => [u[0] - v[0], u[1] - v[1], u[2] - v[2]];
    const along = (u, v, share) => [0, 1, 2].map((k) => u[k] + v[k] * share);
    const [ab, ac, ap, bp, cp] = [sub(b, a), sub(c, a), sub(p, a), sub(p, b), sub(p, c)];
    const [d1, d2, d3, d4, d5, d6] = [dot(ab, ap), dot(ac, ap), dot(ab, bp), dot(ac, bp), dot(ab, cp), dot(ac, cp)];
    const length = (u) => Math.hypot(...sub(p, u));
    if (d1 <= 0 && d2 <= 0) return length(a);
    if (d3 >= 0 && d4 <= d3) return length(b);
    const vc = d1 * d4 - d3 * d2;
    if (vc <= 0 && d1 >= 0 && d3 <= 0) return length(along(a, ab, d1 / (d1 - d3)));
    if (d6 >= 0 && d5 <= d6) return length(c);
    const vb = d5 * d2 - d1 * d6;
    if (vb <= 0 && d2 >= 0 && d6 <= 0) return length(along(a, ac, d2 / (d2 - d6)));
    const va = d3 * d6 - d5 * d4;
    if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) return length(along(b, sub(c, b), (d4 - d3) / (d4 - d3 + (d5 - d6))));
    const whole = 1 / (va + vb + vc);
    return length(along(along(a, ab, vb * whole), ac, vc * whole));
}
