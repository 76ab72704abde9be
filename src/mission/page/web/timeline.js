// Time: the slider, play and pause.

import { clockText } from './model.js';
import { movesLittle } from './theme.js';

// The slider's steps, s.
const STEP_S = 0.1;

export class Timeline {
    constructor({ slider, button, rate, clock, status }, onChange) {
        Object.assign(this, { slider, button, rate, clock, status, onChange, time: 0, duration: 1, isPlaying: false });
        slider.addEventListener('input', () => this.go(Number(slider.value)));
        button.addEventListener('click', () => this.play(!this.isPlaying));
        document.addEventListener('visibilitychange', () => document.hidden && this.play(false));
    }

    setDuration(duration, share) {
        this.duration = duration;
        // Not below the duration, so that the end can be reached.
        Object.assign(this.slider, { min: 0, max: (Math.ceil(duration / STEP_S) * STEP_S).toFixed(1), step: STEP_S });
        this.go(share * duration);
    }

    share() {
        return this.duration > 0 ? this.time / this.duration : 0;
    }

    go(time) {
        this.time = Math.min(Math.max(time, 0), this.duration);
        this.slider.value = this.time.toFixed(1);
        const spoken = `${clockText(this.time)} of ${clockText(this.duration)}`;
        this.slider.setAttribute('aria-valuetext', spoken);
        this.clock.textContent = `${clockText(this.time)} / ${clockText(this.duration)}`;
        this.onChange(this.time);
        this.sayLater();
    }

    // What listens is told where the drone is when it rests there, not at every step.
    sayLater() {
        clearTimeout(this.timer);
        if (!this.isPlaying) this.timer = setTimeout(() => { this.status.textContent = this.describe?.(this.time) ?? ''; }, 500);
    }

    // For who hears the page: what has happened, in place of what was to be said of the time.
    say(text) {
        clearTimeout(this.timer);
        this.status.textContent = text;
    }

    play(isPlaying) {
        if (this.isPlaying === isPlaying) return;
        this.isPlaying = isPlaying;
        this.button.setAttribute('aria-pressed', String(isPlaying));
        this.button.setAttribute('aria-label', isPlaying ? 'Pause' : 'Play');
        if (!isPlaying) return this.sayLater();
        this.onPlay?.();
        if (this.time >= this.duration - STEP_S) this.go(0);
        this.then = performance.now();
        requestAnimationFrame((now) => this.tick(now));
        return undefined;
    }

    tick(now) {
        if (!this.isPlaying) return;
        const passed = Math.max(0, now - this.then) / 1000;
        // Whoever wants little motion sees steps of a second.
        if (!movesLittle() || passed >= 1) {
            this.then = now;
            this.go(this.time + passed * Number(this.rate.value));
        }
        if (this.time >= this.duration) return this.play(false);
        requestAnimationFrame((later) => this.tick(later));
        return undefined;
    }
}
