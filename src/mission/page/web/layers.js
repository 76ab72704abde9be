// What is shown: the switches beside the view, and the legend that goes with them.

import { COVERAGE, cssColour } from './theme.js';
import { node } from './panel.js';

const COVERAGE_MODES = [
    ['off', 'Off'],
    ['now', 'As flown until now'],
    ['final', 'After the flight'],
    ['difference', 'A against B'],
];

export class Layers {
    constructor(state, onChange) {
        this.state = state;
        this.onChange = onChange;
        this.modes = [];
        document.querySelectorAll('[data-layer]').forEach((input) => {
            const key = input.dataset.layer;
            const read = () => (input.type === 'checkbox' ? input.checked : input.value);
            input.addEventListener('change', () => {
                if (key === 'coverage') this.isChosen = true;
                if (input.type !== 'radio' || input.checked) this.set(key, read());
            });
        });
        this.write();
    }

    set(key, value) {
        this.state[key] = value;
        this.write();
        this.onChange(key);
    }

    // Modes of which the data know nothing cannot be chosen.
    allow({ hasCoverage, canDiffer, hasZones, hasCeiling }) {
        this.modes = COVERAGE_MODES.map(([mode]) => mode).filter((mode) => mode === 'off' || (hasCoverage && (mode !== 'difference' || canDiffer)));
        document.querySelectorAll('[data-layer=coverage]').forEach((input) => {
            input.disabled = !this.modes.includes(input.value);
            input.closest('label').hidden = input.value === 'difference' && !canDiffer;
        });
        if (!this.modes.includes(this.state.coverage)) this.state.coverage = this.modes.includes('final') ? 'final' : 'off';
        document.querySelector('[data-layer=zones]').closest('label').hidden = !hasZones;
        document.querySelector('[data-layer=ceiling]').closest('label').hidden = !hasCeiling;
        this.write();
    }

    // Whoever plays the flight wants to see how the surface fills, if nothing else was chosen.
    playing() {
        if (!this.isChosen && this.state.coverage === 'final') this.set('coverage', 'now');
    }

    cycle(key, values) {
        this.isChosen ||= key === 'coverage';
        this.set(key, values[(values.indexOf(this.state[key]) + 1) % values.length]);
    }

    write() {
        document.querySelectorAll('[data-layer]').forEach((input) => {
            const value = this.state[input.dataset.layer];
            if (input.type === 'checkbox') input.checked = value;
            else if (input.type === 'radio') input.checked = input.value === value;
            else input.value = value;
        });
    }

    legend(flight, colours) {
        const [captured, beyond] = [['full', COVERAGE.captured, 'captured'], ['dot', COVERAGE.beyond, 'out of reach or not ordered']];
        const entries = {
            off: [],
            now: [captured, ['ring', COVERAGE.halfway.map((v, k) => v * [1, 0.86, 0.6][k]), 'seen'], ['thin', colours.waiting, 'still to come'], beyond],
            final: [captured, ['ring', COVERAGE.halfway, 'almost enough'], ['ring', COVERAGE.nothing, 'missed'], beyond],
            difference: [['full', COVERAGE.gained, 'only A'], ['ring', COVERAGE.lost, 'only B'], ['dot', colours.waiting, 'the same']],
        }[this.state.coverage];
        document.getElementById('coverage-legend').replaceChildren(...entries.map(([form, colour, text]) => {
            const mark = node('i', { class: form });
            mark.style.setProperty('--mark', cssColour(colour));
            return node('li', {}, mark, text);
        }));
        const stops = this.state.colour === 'time' ? colours.earlyToLate : colours.slowToFast;
        document.documentElement.style.setProperty('--path-ramp', `linear-gradient(to right, ${stops.map(cssColour).join(', ')})`);
        document.documentElement.style.setProperty('--other-path', cssColour(colours.other));
        const [from, to] = this.state.colour === 'time' ? ['start', 'end'] : ['0', `${flight.fastest.toFixed(1)} m/s`];
        document.getElementById('path-ramp-ends').replaceChildren(node('span', {}, from), node('span', {}, to));
    }
}
