// The canvas: what stands on it, the camera, and drawing when something has changed and only then.

const FIELD_OF_VIEW_DEG = 40;
const START_VIEW = { azimuth: 28, elevation: 34 };
// Without a graphics card what moves is drawn with so many pixels of a side, and sharply again when it rests. It moves while one picture follows the
// other within the first time, and rests after the second, ms.
const COARSE = 0.6;
const MOVES_MS = 160;
const RESTS_MS = 240;

export function canDraw() {
    try {
        const gl = document.createElement('canvas').getContext('webgl2');
        if (!gl) return null;
        const info = gl.getExtension('WEBGL_debug_renderer_info');
        const name = String(info ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : gl.getParameter(gl.RENDERER));
        gl.getExtension('WEBGL_lose_context')?.loseContext();
        return { isSoftware: /swiftshader|llvmpipe|software|basic render/i.test(name) };
    } catch {
        return null;
    }
}

export class Stage {
    constructor(canvas, overlay, drawing) {
        this.canvas = canvas;
        this.overlay = overlay;
        // A processor that draws in place of a graphics card gets fewer pixels to fill.
        this.isSoftware = drawing.isSoftware;
        this.sharpness = 1;
        this.drawn = -Infinity;
        this.renderer = new THREE.WebGLRenderer({ canvas, antialias: !drawing.isSoftware, alpha: true, powerPreference: 'low-power' });
        this.renderer.setClearAlpha(0);
        this.renderer.info.autoReset = true;
        // The shaders are the library's own, and asking how they fared waits for the card.
        this.renderer.debug.checkShaderErrors = false;
        this.scene = new THREE.Scene();
        this.camera = new THREE.PerspectiveCamera(FIELD_OF_VIEW_DEG, 1, 1, 10_000);
        this.camera.up.set(0, 0, 1);
        this.controls = new THREE.OrbitControls(this.camera, canvas);
        Object.assign(this.controls, { maxPolarAngle: 0.497 * Math.PI, minDistance: 5, screenSpacePanning: false, zoomToCursor: true, rotateSpeed: 0.7 });
        this.controls.addEventListener('change', () => this.invalidate());
        this.labels = [];
        this.radius = 20;
        this.isDue = false;
        this.frames = 0;
        this.beforeDrawing = [];
        this.retired = [];
        new ResizeObserver(() => this.resize()).observe(canvas.parentElement);
        this.resize();
    }

    resize() {
        const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
        if (width === 0 || height === 0) return;
        this.renderer.setPixelRatio(this.pixelRatio());
        this.renderer.setSize(width, height, false);
        this.camera.aspect = width / height;
        // What is looked at stands in the middle of what the switches leave free.
        this.camera.setViewOffset(width, height, width > 760 ? 105 : 0, 0, width, height);
        this.camera.updateProjectionMatrix();
        this.invalidate();
    }

    // What comes next is to be seen soon rather than sharply, as if it moved.
    hurry() {
        this.drawn = performance.now();
    }

    pixelRatio() {
        return Math.min(window.devicePixelRatio, this.isSoftware ? 1 : 2) * this.sharpness;
    }

    // How sharp a picture that is drawn now is to be.
    sharpen() {
        const sharpness = this.isSoftware && performance.now() - this.drawn < MOVES_MS ? COARSE : 1;
        clearTimeout(this.resting);
        if (sharpness < 1) this.resting = setTimeout(() => this.invalidate(), RESTS_MS);
        if (sharpness === this.sharpness) return;
        this.sharpness = sharpness;
        this.renderer.setPixelRatio(this.pixelRatio());
    }

    invalidate() {
        if (this.isDue) return;
        this.isDue = true;
        requestAnimationFrame(() => this.draw());
    }

    draw() {
        this.isDue = false;
        this.sharpen();
        const distance = this.distance();
        this.camera.near = Math.max(distance / 400, 0.3);
        this.camera.far = distance + 8 * this.radius;
        this.camera.updateProjectionMatrix();
        this.beforeDrawing.forEach((prepare) => prepare());
        this.renderer.render(this.scene, this.camera);
        this.retired.splice(0).forEach(disposeAll);
        this.placeLabels();
        this.frames += 1;
        this.drawn = performance.now();
        if (this.frames === 1) window.overfly.firstFrame = performance.now();
    }

    // Frees a group when what takes its place has been drawn: until then both share shaders, which would have to be made anew.
    retire(group) {
        this.retired.push(group);
    }

    distance() {
        return this.camera.position.distanceTo(this.controls.target);
    }

    // What is to be seen when nothing else is asked for.
    frame(bounds) {
        this.bounds = bounds;
        this.radius = Math.max(Math.hypot(...[0, 1, 2].map((axis) => bounds.max[axis] - bounds.min[axis])) / 2, 20);
        this.controls.maxDistance = 7 * this.radius;
    }

    home() {
        const { min, max } = this.bounds;
        const middle = [0, 1, 2].map((axis) => (min[axis] + max[axis]) / 2);
        const target = [middle[0], middle[1], min[2] + 0.25 * (max[2] - min[2])];
        // How far out the corners come on the screen goes down with the distance; a few rounds are near enough.
        let distance = 2.5 * this.radius;
        for (let round = 0; round < 5; round += 1) {
            this.look({ ...START_VIEW, target, distance });
            this.camera.updateMatrixWorld();
            const outermost = Math.max(...Array.from({ length: 8 }, (_, k) => this.offCentre([k & 1 ? max : min, k & 2 ? max : min, k & 4 ? max : min].map((end, axis) => end[axis]))));
            distance = Math.min(distance * (0.3 + 0.7 * outermost), this.controls.maxDistance);
        }
        this.look({ ...START_VIEW, target, distance });
    }

    // Where a point is between the middle of the view, 0, and the margin that the whole scene leaves, 1.
    offCentre(point) {
        const seen = new THREE.Vector3(...point).project(this.camera);
        const aside = (2 * (this.camera.view?.offsetX ?? 0)) / this.canvas.clientWidth;
        return Math.max(Math.abs(seen.x + aside) / (0.9 - aside), Math.abs(seen.y) / 0.88);
    }

    above() {
        const { target } = this.view();
        this.look({ azimuth: 0, elevation: 89.5, target, distance: this.distance() });
    }

    // Which way the camera looks, clockwise from north, and from how far above the horizon, degrees.
    look({ azimuth, elevation, target, distance }) {
        const [a, e] = [azimuth, elevation].map((angle) => (angle * Math.PI) / 180);
        this.controls.target.set(...target);
        this.camera.position.set(
            target[0] - distance * Math.sin(a) * Math.cos(e),
            target[1] - distance * Math.cos(a) * Math.cos(e),
            target[2] + distance * Math.sin(e),
        );
        this.controls.update();
        this.invalidate();
    }

    view() {
        const { target } = this.controls;
        const away = this.camera.position.clone().sub(target);
        const distance = away.length();
        return {
            azimuth: (Math.atan2(-away.x, -away.y) * 180) / Math.PI,
            elevation: (Math.asin(away.z / distance) * 180) / Math.PI,
            target: target.toArray(),
            distance,
        };
    }

    turn(azimuth, elevation) {
        const view = this.view();
        this.look({ ...view, azimuth: view.azimuth + azimuth, elevation: Math.min(Math.max(view.elevation + elevation, 1), 89.5) });
    }

    zoom(factor) {
        const view = this.view();
        this.look({ ...view, distance: Math.min(Math.max(view.distance * factor, 5), this.controls.maxDistance) });
    }

    // Over the ground, in shares of the distance.
    pan(right, forward) {
        const view = this.view();
        const a = (view.azimuth * Math.PI) / 180;
        const [x, y] = [right * Math.cos(a) + forward * Math.sin(a), forward * Math.cos(a) - right * Math.sin(a)];
        const step = 0.06 * view.distance;
        this.look({ ...view, target: [view.target[0] + step * x, view.target[1] + step * y, view.target[2]] });
    }

    // The ray through a place of the canvas, px from its top left corner.
    ray(x, y) {
        const { clientWidth: width, clientHeight: height } = this.canvas;
        const through = new THREE.Vector3((2 * x) / width - 1, 1 - (2 * y) / height, 0.5).unproject(this.camera);
        return { from: this.camera.position.toArray(), towards: through.sub(this.camera.position).normalize().toArray() };
    }

    // Where a point is on the canvas, px; none behind the camera.
    project(point) {
        const seen = new THREE.Vector3(...point).project(this.camera);
        if (seen.z > 1 || seen.z < -1) return null;
        return [((seen.x + 1) / 2) * this.canvas.clientWidth, ((1 - seen.y) / 2) * this.canvas.clientHeight];
    }

    setLabels(labels) {
        this.labels.forEach(({ element }) => element.remove());
        this.labels = labels.map(({ at, text, kind }) => {
            const element = document.createElement('span');
            element.className = `label ${kind}`;
            element.textContent = text;
            this.overlay.append(element);
            return { at, element };
        });
        this.invalidate();
    }

    placeLabels() {
        for (const { at, element } of this.labels) {
            const place = this.project(at);
            element.hidden = place === null;
            if (place) element.style.transform = `translate(${place[0].toFixed(1)}px, ${place[1].toFixed(1)}px)`;
        }
    }
}

// Frees what the graphics card holds of a group.
function disposeAll(group) {
    group.traverse((part) => {
        part.geometry?.dispose();
        part.material?.dispose();
    });
}
