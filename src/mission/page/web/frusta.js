// What images frame: the last one taken as far as it sees, and all of them as small frames.

import { cross } from './structures.js';

// Longest side of a frame that meets nothing, m, and length of the small ones.
const SIGHT_M = 70;
const SMALL_M = 5;

export class Frusta {
    constructor(flight) {
        this.flight = flight;
        this.group = new THREE.Group();
        this.halves = flight.cameras.map(({ fov_deg: fov }) => fov && fov.map((angle) => Math.tan((angle * Math.PI) / 360)));
        this.current = new THREE.Group();
        this.lines = new THREE.LineSegments(new THREE.BufferGeometry(), new THREE.LineBasicMaterial());
        this.faces = new THREE.Mesh(new THREE.BufferGeometry(), new THREE.MeshBasicMaterial({ transparent: true, opacity: 0.16 / Math.sqrt(flight.cameras.length), side: THREE.DoubleSide, depthWrite: false }));
        this.current.add(this.faces, this.lines);
        this.all = this.makeAll();
        this.all.visible = false;
        [this.lines, this.faces].forEach((part) => { part.frustumCulled = false; });
        this.group.add(this.current, this.all);
    }

    axes(k) {
        const { directions, ups } = this.flight.images;
        const forward = Array.from(directions.subarray(3 * k, 3 * k + 3));
        const up = Array.from(ups.subarray(3 * k, 3 * k + 3));
        return { forward, up, right: cross(forward, up) };
    }

    // The frames of some images, from `images`, as far as they meet something of what `meet` knows.
    show(images, meet) {
        const [lines, faces] = [[], []];
        for (const k of images) {
            const at = Array.from(this.flight.images.positions.subarray(3 * k, 3 * k + 3));
            const half = this.halves[this.flight.images.cameras[k]];
            if (!half) {
                lines.push(...ringsAround(at, 7));
                continue;
            }
            const { forward, up, right } = this.axes(k);
            const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([a, b]) => {
                const ray = [0, 1, 2].map((axis) => forward[axis] + a * half[0] * right[axis] + b * half[1] * up[axis]);
                const length = Math.hypot(...ray);
                const towards = ray.map((value) => value / length);
                const far = Math.min(meet(at, towards), SIGHT_M);
                return at.map((value, axis) => value + towards[axis] * far);
            });
            corners.forEach((corner, c) => {
                const next = corners[(c + 1) % 4];
                lines.push(...at, ...corner, ...corner, ...next);
                faces.push(...at, ...corner, ...next);
            });
        }
        this.lines.geometry.dispose();
        this.faces.geometry.dispose();
        this.lines.geometry = new THREE.BufferGeometry().setAttribute('position', new THREE.Float32BufferAttribute(lines, 3));
        this.faces.geometry = new THREE.BufferGeometry().setAttribute('position', new THREE.Float32BufferAttribute(faces, 3));
    }

    makeAll() {
        const { count, positions, directions, ups, cameras, selected } = this.flight.images;
        const geometry = new THREE.InstancedBufferGeometry();
        geometry.instanceCount = count;
        const hasFrames = this.halves.some((half) => half !== null);
        // Apex and four corners, or a diamond around the place of a panorama.
        const pyramid = [[0, 0, 0, -1, -1, 1], [0, 0, 0, 1, -1, 1], [0, 0, 0, 1, 1, 1], [0, 0, 0, -1, 1, 1], [-1, -1, 1, 1, -1, 1], [1, -1, 1, 1, 1, 1], [1, 1, 1, -1, 1, 1], [-1, 1, 1, -1, -1, 1]];
        const tips = [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]];
        const diamond = tips.flatMap((tip, k) => [[...tip, ...tips[(k + 1) % 4]], [...tip, 0, 0, 1], [...tip, 0, 0, -1]]);
        geometry.setAttribute('position', new THREE.Float32BufferAttribute((hasFrames ? pyramid : diamond).flat(), 3));
        const halves = new Float32Array(2 * count);
        for (let k = 0; k < count; k += 1) halves.set(this.halves[cameras[k]] ?? [1, 1], 2 * k);
        const each = (name, values, size) => geometry.setAttribute(name, new THREE.InstancedBufferAttribute(values, size));
        each('place', positions, 3);
        each('forward', directions, 3);
        each('above', ups, 3);
        each('halves', halves, 2);
        each('chosen', Float32Array.from(selected), 1);
        const material = new THREE.ShaderMaterial({
            uniforms: { chosenColour: { value: new THREE.Vector3() }, otherColour: { value: new THREE.Vector3() } },
            vertexShader: `
                attribute vec3 place; attribute vec3 forward; attribute vec3 above; attribute vec2 halves; attribute float chosen;
                uniform vec3 chosenColour; uniform vec3 otherColour; varying vec3 colour;
                void main() {
                    colour = mix(otherColour, chosenColour, chosen);
                    float size = ${SMALL_M.toFixed(1)} * mix(0.6, 1.0, chosen);
                    vec3 corner = dot(forward, forward) > 0.5
                        ? forward * position.z + cross(forward, above) * position.x * halves.x + above * position.y * halves.y
                        : position * 0.3;
                    gl_Position = projectionMatrix * modelViewMatrix * vec4(place + size * corner, 1.0);
                }`,
            fragmentShader: 'varying vec3 colour; void main() { gl_FragColor = vec4(colour, 1.0); }',
        });
        const all = new THREE.LineSegments(geometry, material);
        all.frustumCulled = false;
        return all;
    }

    paint(colours) {
        this.lines.material.color.setRGB(...colours.frustum, 'srgb');
        this.faces.material.color.setRGB(...colours.frustum, 'srgb');
        this.all.material.uniforms.chosenColour.value.set(...colours.selectedImage);
        this.all.material.uniforms.otherColour.value.set(...colours.otherImage);
    }
}

function ringsAround([x, y, z], radius) {
    const lines = [];
    const corners = 32;
    for (let k = 0; k < corners; k += 1) {
        const [a, b] = [k, k + 1].map((step) => (2 * Math.PI * step) / corners);
        const [ca, sa, cb, sb] = [Math.cos(a), Math.sin(a), Math.cos(b), Math.sin(b)].map((value) => value * radius);
        lines.push(x + ca, y + sa, z, x + cb, y + sb, z, x + ca, y, z + sa, x + cb, y, z + sb, x, y + ca, z + sa, x, y + cb, z + sb);
    }
    return lines;
}
