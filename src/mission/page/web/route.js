// A flight's path as a line that is coloured by speed or time, with its waypoints; and the drone on it.

import { distanceOf, rampColour } from './model.js';
import { meshOf } from './surroundings.js';

// Steps of a ramp that nobody can tell apart.
const SHADES = 512;
// The two triangles of a strip of four corners.
const CORNERS = [0, 1, 2, 2, 1, 3];

export class Route {
    constructor(flight, isOther) {
        this.flight = flight;
        this.isOther = isOther;
        this.group = new THREE.Group();
        this.ribbon = new Ribbon(flight.path, isOther ? 2.8 : 3.8);
        this.waypoints = pointsOf(flight.waypoints, 5);
        this.waypoints.visible = false;
        this.ends = pointsOf(flight.waypoints.length >= 6 ? [...flight.waypoints.slice(0, 3), ...flight.waypoints.slice(-3)] : flight.waypoints, 10);
        this.group.add(this.ribbon.mesh, this.waypoints, this.ends);
    }

    paint(colours, by) {
        const { path, fastest, duration_s: duration } = this.flight;
        const [values, most] = by === 'time' ? [path.times, duration] : [path.speeds, fastest];
        const stops = by === 'time' ? colours.earlyToLate : colours.slowToFast;
        const shade = (k) => (this.isOther ? colours.other : rampColour(stops, k / SHADES)).map((value) => 255 * value);
        const ramp = Array.from({ length: SHADES + 1 }, (_, k) => shade(k));
        const scale = SHADES / Math.max(most, 1e-6);
        this.ribbon.paint((k) => ramp[Math.min(Math.max(Math.round(values[k] * scale), 0), SHADES)], colours.casing);
        this.waypoints.material.uniforms.colour.value.set(...colours.drone);
        this.waypoints.material.uniforms.rim.value.set(...colours.casing);
        this.ends.material.uniforms.colour.value.set(...(this.isOther ? colours.other : colours.drone));
        this.ends.material.uniforms.rim.value.set(...colours.casing);
    }

    labels(prefix) {
        const corner = (from) => Array.from(this.flight.waypoints.slice(from, from + 3));
        const last = this.flight.waypoints.length - 3;
        if (last < 3) return [{ at: corner(0), text: `${prefix}start`, kind: 'end' }];
        const [first, end] = [corner(0), corner(last)];
        if (distanceOf(first, end) < 3) return [{ at: first, text: `${prefix}start and end`, kind: 'end' }];
        return [{ at: first, text: `${prefix}start`, kind: 'end' }, { at: end, text: `${prefix}end`, kind: 'end' }];
    }
}

// A line of one width on the screen, px: for each piece of the path a strip that is turned to the viewer, with a rim that sets it off from whatever is behind it.
class Ribbon {
    constructor({ count, positions }, width) {
        const pieces = Math.max(count - 1, 0);
        this.pieces = pieces;
        const [ends, others] = [new Float32Array(12 * pieces), new Float32Array(12 * pieces)];
        const indices = new Uint32Array(6 * pieces);
        for (let k = 0; k < pieces; k += 1) {
            for (let c = 0; c < 4; c += 1) {
                const [own, other] = c < 2 ? [3 * k, 3 * k + 3] : [3 * k + 3, 3 * k];
                for (let axis = 0; axis < 3; axis += 1) {
                    ends[12 * k + 3 * c + axis] = positions[own + axis];
                    others[12 * k + 3 * c + axis] = positions[other + axis];
                }
            }
            for (let c = 0; c < 6; c += 1) indices[6 * k + c] = 4 * k + CORNERS[c];
        }
        const geometry = new THREE.BufferGeometry();
        geometry.setAttribute('position', new THREE.BufferAttribute(ends, 3));
        geometry.setAttribute('other', new THREE.BufferAttribute(others, 3));
        geometry.setAttribute('colour', new THREE.BufferAttribute(new Uint8Array(12 * pieces), 3, true));
        geometry.setIndex(new THREE.BufferAttribute(indices, 1));
        this.material = new THREE.ShaderMaterial({
            side: THREE.DoubleSide,
            uniforms: { width: { value: width }, size: { value: new THREE.Vector2(1, 1) }, rim: { value: new THREE.Vector3() } },
            vertexShader: `
                attribute vec3 other; attribute vec3 colour;
                uniform float width; uniform vec2 size;
                varying vec3 shade; varying float side;
                void main() {
                    // The first two corners stand at the beginning of a piece, the others at its end.
                    float ahead = (gl_VertexID & 2) == 0 ? 1.0 : -1.0;
                    side = (gl_VertexID & 1) == 0 ? -1.0 : 1.0;
                    shade = colour;
                    vec4 here = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
                    vec4 there = projectionMatrix * modelViewMatrix * vec4(other, 1.0);
                    float least = 0.01;
                    if (here.w < least) here = mix(here, there, (least - here.w) / max(there.w - here.w, 1e-6));
                    if (there.w < least) there = mix(there, here, (least - there.w) / max(here.w - there.w, 1e-6));
                    vec2 way = (there.xy / there.w - here.xy / here.w) * size * ahead;
                    float pixels = length(way);
                    way = pixels > 1e-6 ? way / pixels : vec2(1.0, 0.0);
                    // A little beyond the ends, so that pieces meet.
                    vec2 offset = vec2(-way.y, way.x) * side - way * ahead * 0.4;
                    here.xy += offset * width / size * here.w;
                    gl_Position = here;
                }`,
            fragmentShader: `
                uniform vec3 rim; varying vec3 shade; varying float side;
                void main() { gl_FragColor = vec4(abs(side) > 0.62 ? mix(shade, rim, 0.72) : shade, 1.0); }`,
        });
        this.mesh = new THREE.Mesh(geometry, this.material);
        this.mesh.frustumCulled = false;
        this.mesh.visible = pieces > 0;
        this.mesh.onBeforeRender = (renderer) => renderer.getSize(this.material.uniforms.size.value);
    }

    // `colourAt` gives the colour at a sample of the path, in bytes.
    paint(colourAt, rim) {
        const bytes = this.mesh.geometry.attributes.colour.array;
        for (let k = 0; k < this.pieces; k += 1) {
            const [from, to] = [colourAt(k), colourAt(k + 1)];
            for (let c = 0; c < 4; c += 1) {
                for (let channel = 0; channel < 3; channel += 1) bytes[12 * k + 3 * c + channel] = (c < 2 ? from : to)[channel];
            }
        }
        this.mesh.geometry.attributes.colour.needsUpdate = true;
        this.material.uniforms.rim.value.set(...rim);
    }
}

// Round points of one size on the screen, px.
function pointsOf(positions, size) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.Float32BufferAttribute(Array.from(positions), 3));
    const material = new THREE.ShaderMaterial({
        uniforms: { colour: { value: new THREE.Vector3() }, rim: { value: new THREE.Vector3() }, size: { value: size } },
        vertexShader: 'uniform float size; void main() { gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); gl_PointSize = size; }',
        fragmentShader: `uniform vec3 colour; uniform vec3 rim;
            void main() { float r = length(gl_PointCoord - 0.5); if (r > 0.5) discard; gl_FragColor = vec4(r > 0.36 ? rim : colour, 1.0); }`,
    });
    const points = new THREE.Points(geometry, material);
    points.frustumCulled = false;
    return points;
}

export class Drone {
    constructor() {
        this.group = new THREE.Group();
        // An arrow head that is seen from all sides, one unit long, nose to the east.
        const [nose, left, right, top, bottom] = [[0.62, 0, 0], [-0.38, 0.4, 0], [-0.38, -0.4, 0], [-0.2, 0, 0.24], [-0.2, 0, -0.16]];
        const faces = [nose, left, top, nose, top, right, nose, bottom, left, nose, right, bottom, left, bottom, top, right, top, bottom];
        this.body = meshOf(faces.flat(), new THREE.MeshBasicMaterial({ side: THREE.DoubleSide }));
        const rim = [nose, left, nose, right, left, top, right, top, nose, top, left, bottom, right, bottom].flat();
        this.rim = new THREE.LineSegments(new THREE.BufferGeometry(), new THREE.LineBasicMaterial());
        this.rim.geometry.setAttribute('position', new THREE.Float32BufferAttribute(rim, 3));
        this.body.add(this.rim);
        // Straight down to what is below it: how high it is, is hard to see otherwise.
        this.plumb = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ transparent: true, opacity: 0.6 }));
        this.plumb.geometry.setAttribute('position', new THREE.Float32BufferAttribute([0, 0, 0, 0, 0, -1], 3));
        this.group.add(this.body, this.plumb);
        [this.body, this.rim, this.plumb].forEach((part) => { part.frustumCulled = false; });
    }

    paint(colours) {
        this.body.material.color.setRGB(...colours.drone, 'srgb');
        this.rim.material.color.setRGB(...colours.casing, 'srgb');
        this.plumb.material.color.setRGB(...colours.drone, 'srgb');
    }

    place({ position, way }, below, size) {
        this.group.position.set(...position);
        const level = Math.hypot(way[0], way[1]);
        if (level > 1e-6) this.body.rotation.z = Math.atan2(way[1], way[0]);
        this.body.scale.setScalar(size);
        this.plumb.scale.set(1, 1, Math.max(below, 0.01));
    }
}
