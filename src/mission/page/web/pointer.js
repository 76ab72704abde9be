// What the pointer is on: names and figures of structures, and a measure between two places.

import { distanceOf, lengthText } from './model.js';
import { palette } from './theme.js';

export class Pointer {
    constructor({ stage, tip, world, onPick }) {
        Object.assign(this, { stage, tip, world, onPick, measured: [], isMeasuring: false });
        this.group = new THREE.Group();
        this.line = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ depthTest: false, transparent: true }));
        this.line.renderOrder = 5;
        this.line.frustumCulled = false;
        this.group.add(this.line);
        const { canvas } = stage;
        canvas.addEventListener('pointermove', (event) => this.move(event));
        canvas.addEventListener('pointerleave', () => this.hide());
        canvas.addEventListener('pointerdown', (event) => { this.pressed = [event.clientX, event.clientY]; });
        canvas.addEventListener('pointerup', (event) => {
            const isClick = this.pressed && Math.hypot(event.clientX - this.pressed[0], event.clientY - this.pressed[1]) < 5;
            this.pressed = null;
            if (isClick && event.button === 0) this.choose(event.offsetX, event.offsetY);
        });
    }

    // What lies under a place of the canvas: a structure or the ground.
    at(x, y) {
        if (!this.world()) return null;
        const { from, towards } = this.stage.ray(x, y);
        const met = this.world().structures.meet(from, towards);
        if (met) return met;
        const ground = this.world().scene.terrain ? null : -from[2] / towards[2];
        return ground > 0 ? { structure: null, point: from.map((value, axis) => value + towards[axis] * ground) } : null;
    }

    move(event) {
        if (this.pressed || event.pointerType === 'touch') return this.hide();
        this.last = [event.offsetX, event.offsetY];
        if (this.isWaiting) return undefined;
        this.isWaiting = true;
        requestAnimationFrame(() => {
            this.isWaiting = false;
            if (this.last) this.tell(...this.last);
        });
        return undefined;
    }

    tell(x, y) {
        const found = this.at(x, y);
        const lines = found?.structure ? this.world().describe(found.structure) : null;
        if (this.isMeasuring) this.draw(this.measured.length === 1 && found ? [this.measured[0], found.point] : this.measured);
        if (!lines) return this.hide();
        this.tip.replaceChildren(...lines.map((text, k) => Object.assign(document.createElement(k === 0 ? 'strong' : 'span'), { textContent: text })));
        this.tip.hidden = false;
        const right = x + 18 + this.tip.offsetWidth > this.stage.canvas.clientWidth;
        this.tip.style.transform = `translate(${right ? x - 14 - this.tip.offsetWidth : x + 16}px, ${Math.max(8, y - 10)}px)`;
        return undefined;
    }

    hide() {
        this.last = null;
        this.tip.hidden = true;
    }

    // A click, or the enter key for the middle of the canvas.
    choose(x, y) {
        const found = this.at(x, y);
        if (this.isMeasuring) return found && this.measure(found.point);
        return this.onPick(found?.structure ?? null, found?.point ?? null);
    }

    startMeasuring(isOn) {
        this.isMeasuring = isOn;
        this.measured = [];
        this.draw([]);
        this.world().say(isOn ? 'Measuring: click two places, or press Enter for the middle of the view.' : '');
    }

    measure(point) {
        this.measured = this.measured.length === 1 ? [this.measured[0], point] : [point];
        this.draw(this.measured);
        if (this.measured.length < 2) return this.world().say('First place taken. Choose the second one.');
        const [a, b] = this.measured;
        const level = Math.hypot(a[0] - b[0], a[1] - b[1]);
        this.result = { distance: distanceOf(a, b), horizontal: level, vertical: Math.abs(a[2] - b[2]) };
        return this.world().say(`${lengthText(this.result.distance)} apart: ${lengthText(level)} horizontally, ${lengthText(this.result.vertical)} vertically.`);
    }

    draw(points) {
        this.line.geometry.dispose();
        this.line.geometry = new THREE.BufferGeometry().setAttribute('position', new THREE.Float32BufferAttribute(points.flat(), 3));
        this.line.visible = points.length === 2;
        this.line.material.color.setRGB(...palette().selectedImage, 'srgb');
        const labels = points.length === 2 ? [{ at: points[0].map((value, axis) => (value + points[1][axis]) / 2), text: lengthText(distanceOf(...points)), kind: 'measure' }] : [];
        this.world().label('measure', labels);
    }
}
