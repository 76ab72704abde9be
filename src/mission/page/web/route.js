// A flight's path as a line that is coloured by speed or time, with its waypoints; and the drone on it.

export class Route {
    constructor(flight, isOther) {
        this.flight = flight;
        this.isOther = isOther;
        this.group = new THREE.Group();
        const { count, positions } = flight.path;
        const ends = new Float32Array(6 * Math.max(count - 1, 0));
        for (let k = 0; k + 1 < count; k += 1) ends.set(positions.subarray(3 * k, 3 * k + 6), 6 * k);
        const geometry = new THREE.LineSegmentsGeometry();
        if (ends.length > 0) geometry.setPositions(ends);
        // A casing sets the line off from whatever is behind it.
        this.casing = new THREE.LineSegments2(geometry, new THREE.LineMaterial({ linewidth: isOther ? 3 : 4.5, transparent: true, opacity: 0.5, depthWrite: false }));
        this.line = new THREE.LineSegments2(geometry, new THREE.LineMaterial({ linewidth: isOther ? 1.6 : 2.4, vertexColors: true }));
        this.waypoints = pointsOf(flight.waypoints, 5);
        this.waypoints.visible = false;
        this.ends = pointsOf(flight.waypoints.length >= 6 ? [...flight.waypoints.slice(0, 3), ...flight.waypoints.slice(-3)] : flight.waypoints, 10);
        [this.casing, this.line].forEach((line) => { line.frustumCulled = false; });
        if (ends.length > 0) this.group.add(this.casing, this.line);
        this.group.add(this.waypoints, this.ends);
    }

    paint(colours, by) {
        const { path, fastest, duration_s: duration } = this.flight;
        const share = by === 'time' ? (k) => path.times[k] / Math.max(duration, 1e-6) : (k) => path.speeds[k] / Math.max(fastest, 1e-6);
        const stops = by === 'time' ? colours.earlyToLate : colours.slowToFast;
        const bytes = new Float32Array(6 * Math.max(path.count - 1, 0));
        for (let k = 0; k + 1 < path.count; k += 1) {
            for (const end of [0, 1]) {
                const colour = this.isOther ? colours.other : rampColour(stops, share(k + end));
                bytes.set(colour.map(linear), 6 * k + 3 * end);
            }
        }
        if (bytes.length > 0) this.line.geometry.setColors(bytes);
        this.casing.material.color.setRGB(...colours.casing, 'srgb');
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
