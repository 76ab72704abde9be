// What is around the structures: the ground with a grid, no-fly zones and the legal ceiling.

const NICE_M = [5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000];
// A zone without an upper end is drawn this high, m.
const ENDLESS_M = 400;

export const niceLength = (metres) => NICE_M.find((nice) => nice >= metres) ?? NICE_M[NICE_M.length - 1];

export class Surroundings {
    // `groundAt` tells how high the ground is at a place.
    constructor(scene, bounds, groundAt) {
        this.scene = scene;
        this.groundAt = groundAt;
        this.group = new THREE.Group();
        this.zones = new THREE.Group();
        const extent = Math.max(bounds.max[0] - bounds.min[0], bounds.max[1] - bounds.min[1], 60);
        this.middle = [0, 1].map((axis) => (bounds.min[axis] + bounds.max[axis]) / 2);
        this.gridStep = niceLength(extent / 14);
        this.ground = scene.terrain ? null : this.makeGround(extent);
        if (this.ground) this.group.add(this.ground);
        scene.zones.forEach((zone) => this.addZone(zone, bounds));
        this.ceiling = this.makeCeiling(bounds);
        if (this.ceiling) this.group.add(this.ceiling);
        this.group.add(this.zones);
    }

    // A plane with lines on it that fades into the sky.
    makeGround(extent) {
        const reach = 3.2 * extent;
        const [x, y] = this.middle;
        const geometry = new THREE.BufferGeometry();
        const corners = [[-1, -1], [1, -1], [1, 1], [-1, -1], [1, 1], [-1, 1]];
        const positions = corners.flatMap(([a, b]) => [x + a * reach, y + b * reach, -0.05]);
        geometry.setAttribute('position', new THREE.Float32BufferAttribute(positions, 3));
        const material = new THREE.ShaderMaterial({
            transparent: true,
            depthWrite: false,
            uniforms: {
                plain: { value: new THREE.Vector3() },
                line: { value: new THREE.Vector3() },
                middle: { value: new THREE.Vector2(x, y) },
                stride: { value: this.gridStep },
                reach: { value: reach },
            },
            vertexShader: 'varying vec2 place; void main() { place = position.xy; gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }',
            fragmentShader: `
                uniform vec3 plain; uniform vec3 line; uniform vec2 middle; uniform float stride; uniform float reach;
                varying vec2 place;
                float along(float step) {
                    vec2 cell = place / step;
                    vec2 width = fwidth(cell);
                    vec2 near = abs(fract(cell - 0.5) - 0.5) / max(width, 1e-6);
                    float fade = 1.0 - smoothstep(0.12, 0.5, max(width.x, width.y));
                    return fade * (1.0 - min(min(near.x, near.y), 1.0));
                }
                void main() {
                    float far = smoothstep(0.25, 1.0, length(place - middle) / reach);
                    float grid = max(0.55 * along(stride), along(5.0 * stride));
                    gl_FragColor = vec4(mix(plain, line, grid), 1.0 - far);
                }`,
        });
        const ground = new THREE.Mesh(geometry, material);
        ground.renderOrder = -2;
        ground.frustumCulled = false;
        return ground;
    }

    addZone(zone, bounds) {
        const floor = Math.max(zone.floor_m, 0);
        const top = Math.min(zone.ceiling_m ?? Infinity, Math.max(bounds.max[2] + 60, ENDLESS_M));
        const [faces, lines] = [[], []];
        // Zones count from the ground below.
        const at = ([x, y], above) => [x, y, this.groundAt([x, y]) + above];
        for (let k = 0; k < zone.area.length; k += 2) faces.push(...at(zone.area.subarray(k, k + 2), top));
        for (const ring of zone.rings) {
            ring.forEach((corner, k) => {
                const next = ring[(k + 1) % ring.length];
                const [a, b, c, d] = [at(corner, floor), at(next, floor), at(next, top), at(corner, top)];
                faces.push(...a, ...b, ...c, ...a, ...c, ...d);
                lines.push(...a, ...b, ...d, ...c, ...a, ...d);
            });
        }
        const solid = meshOf(faces, new THREE.MeshBasicMaterial({ transparent: true, opacity: 0.16, side: THREE.DoubleSide, depthWrite: false }));
        const outline = new THREE.LineSegments(new THREE.BufferGeometry(), new THREE.LineBasicMaterial());
        outline.geometry.setAttribute('position', new THREE.Float32BufferAttribute(lines, 3));
        this.zones.add(solid, outline);
    }

    // Where flights over this town end: a frame and faint lines at the legal ceiling above the plane z = 0.
    makeCeiling(bounds) {
        const height = this.scene.ceiling_m;
        if (!height || this.scene.terrain || this.scene.structures.length === 0) return null;
        const [west, south, east, north] = [bounds.min[0], bounds.min[1], bounds.max[0], bounds.max[1]];
        const lines = [west, south, east, south, east, south, east, north, east, north, west, north, west, north, west, south];
        const step = 5 * this.gridStep;
        for (let x = Math.ceil(west / step) * step; x < east; x += step) lines.push(x, south, x, north);
        for (let y = Math.ceil(south / step) * step; y < north; y += step) lines.push(west, y, east, y);
        const geometry = new THREE.BufferGeometry();
        const positions = [];
        for (let k = 0; k < lines.length; k += 2) positions.push(lines[k], lines[k + 1], height);
        geometry.setAttribute('position', new THREE.Float32BufferAttribute(positions, 3));
        const ceiling = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ transparent: true, opacity: 0.55, depthWrite: false }));
        ceiling.visible = false;
        return ceiling;
    }

    paint(colours) {
        if (this.ground) {
            const { plain, line } = this.ground.material.uniforms;
            plain.value.set(...colours.ground);
            line.value.set(...colours.grid);
        }
        this.zones.children.forEach((part) => part.material.color.setRGB(...colours.zone, 'srgb'));
        this.ceiling?.material.color.setRGB(...colours.ceiling, 'srgb');
    }

    // Names and heights of the zones, to be written where they are.
    labels() {
        return this.scene.zones.map((zone) => {
            const ring = zone.rings[0];
            const middle = [0, 1].map((axis) => ring.reduce((sum, corner) => sum + corner[axis], 0) / ring.length);
            const top = zone.ceiling_m ?? ENDLESS_M;
            const upper = zone.ceiling_m === null ? 'no upper end' : `${Math.round(zone.ceiling_m)} m`;
            const at = [...middle, this.groundAt(middle) + Math.min(top, 150)];
            return { at, text: `${zone.name}: ${Math.round(Math.max(zone.floor_m, 0))} m to ${upper}`, kind: 'zone' };
        });
    }
}

export function meshOf(positions, material) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.Float32BufferAttribute(positions, 3));
    return new THREE.Mesh(geometry, material);
}
