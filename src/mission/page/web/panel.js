// Words and figures: what the plan is, what it comes to, and the structures as a table for those who do not look at the picture.

import { clockText, lengthText } from './model.js';

// Rows of the table of structures.
const MOST_ROWS = 200;

export const node = (name, attributes = {}, ...children) => {
    const made = document.createElement(name);
    Object.entries(attributes).forEach(([key, value]) => made.setAttribute(key, value));
    made.append(...children.filter((child) => child !== null && child !== undefined));
    return made;
};

const percentText = (value) => (value === null || value === undefined ? null : `${value.toFixed(1)} %`);

// Label, value as text, and the number behind it with the sign of what is better.
export function figuresOf(flight) {
    const { figures } = flight;
    const rows = [
        ['Captured', percentText(figures.coverage_percent), 'of what the rig can capture', figures.coverage_percent, 1],
        ['In matched views', figures.matched_percent > 0 ? percentText(figures.matched_percent) : null, 'of what can be', figures.matched_percent, 1],
        ['Time', clockText(flight.duration_s), `${Math.round(flight.duration_s)} s`, flight.duration_s, -1],
        ['Length', lengthText(figures.length_m), `${figures.waypoints} waypoints`, figures.length_m, -1],
        ['Images', String(figures.images), `${figures.selected_images} selected`, figures.images, 0],
        ['Least clearance', flight.clearance_m === null ? null : `${flight.clearance_m.toFixed(1)} m`, 'to structures and ground', flight.clearance_m, 1],
        ['Fastest', `${flight.fastest.toFixed(1)} m/s`, flight.cruise_mps ? `cruise ${flight.cruise_mps.toFixed(1)} m/s` : '', flight.fastest, 0],
        ['Battery', figures.battery_percent ? `${figures.battery_percent.toFixed(0)} %` : null, 'of one, without ways out and home', figures.battery_percent, -1],
        ['Capturable', percentText(figures.capturable_percent), 'of the surface, by this rig', figures.capturable_percent, 0],
    ];
    return rows.filter((row) => row[1] !== null).map(([label, text, remark, value, better]) => ({ label, text, remark, value, better }));
}

export function showHeading(flight) {
    document.getElementById('name').textContent = flight.scene_name || 'Plan';
    const revision = flight.revision > 1 ? ` · revision ${flight.revision}` : '';
    document.getElementById('about').textContent = `${flight.rig} · ${flight.method} · seed ${flight.seed}${revision}`;
    document.title = `${flight.scene_name || 'plan'} · overfly`;
}

export function showFigures(flight) {
    const rows = figuresOf(flight).map(({ label, text, remark }) => node('div', {}, node('dt', {}, label), node('dd', {}, text, node('small', {}, remark))));
    document.getElementById('figures').replaceChildren(node('dl', { class: 'figures' }, ...rows));
}

export function showSorties(flight, onJump) {
    const section = document.getElementById('sorties');
    const { sorties, sorties_note: note } = flight;
    section.hidden = sorties.length === 0 ? !note : sorties.length === 1 && sorties[0].battery_percent === null;
    if (section.hidden) return;
    const button = ({ number, start_s: start }) => {
        const made = node('button', { type: 'button', class: 'link', 'aria-label': `Go to the beginning of sortie ${number}` }, clockText(start));
        made.addEventListener('click', () => onJump(start));
        return made;
    };
    const rows = sorties.map((sortie) =>
        node('tr', {}, node('th', { scope: 'row' }, String(sortie.number)), node('td', {}, button(sortie)), node('td', {}, clockText(sortie.duration_s)),
            node('td', {}, sortie.battery_percent === null ? '–' : `${sortie.battery_percent.toFixed(0)} %`)));
    const head = node('tr', {}, ...['No.', 'Begins', 'In the air', 'Battery'].map((title) => node('th', { scope: 'col' }, title)));
    const table = node('table', {}, node('thead', {}, head), node('tbody', {}, ...rows));
    const heading = node('h2', {}, sorties.length > 1 ? `${sorties.length} sorties` : 'Sorties');
    section.replaceChildren(heading, rows.length > 0 ? table : node('p', { class: 'quiet' }, `Not divided into sorties: ${note}`));
    if (rows.length > 0) section.append(node('p', { class: 'quiet' }, 'In the air: with the ways out and home, landing with a quarter of the battery left.'));
}

export function showPicked(lines) {
    const section = document.getElementById('picked');
    section.hidden = lines === null;
    if (lines) section.replaceChildren(node('h2', {}, lines[0]), ...lines.slice(1).map((line) => node('p', {}, line)));
}

// Filled when it is opened: a town has thousands of rows.
export function showTable(flight) {
    const details = document.getElementById('structures-table');
    const fill = () => {
        if (!details.open) return;
        const rows = flight.scene.structures.filter(({ kind }) => kind !== 'terrain').map((structure) => ({ structure, tally: flight.coverage?.tallies[structure.index] }));
        const share = ({ tally }) => (tally?.capturable ? tally.captured / tally.capturable : 2);
        rows.sort((a, b) => share(a) - share(b));
        const cells = rows.slice(0, MOST_ROWS).map(({ structure, tally }) => {
            const covered = tally?.capturable ? `${((100 * tally.captured) / tally.capturable).toFixed(0)} %` : '–';
            return node('tr', {}, node('th', { scope: 'row' }, structure.name), node('td', {}, `${(structure.top_m - structure.base_m).toFixed(1)} m`), node('td', {}, covered));
        });
        const head = node('tr', {}, ...['Structure', 'Height', 'Captured'].map((title) => node('th', { scope: 'col' }, title)));
        const more = rows.length > MOST_ROWS ? `The ${MOST_ROWS} that are captured least, of ${rows.length}.` : `${rows.length} structures, those that are captured least first.`;
        details.querySelector('div').replaceChildren(node('p', { class: 'quiet' }, more), node('table', {}, node('thead', {}, head), node('tbody', {}, ...cells)));
    };
    details.ontoggle = fill;
    fill();
}

export function showNotes(flights, { scene, coverage }, apart) {
    const notes = flights.flatMap((flight) => flight.notes);
    if (apart) notes.push(apart);
    if (scene.structures.length === 0) notes.push('Only the plan is here, without its scene: no structures and no coverage. Give the scene with --scene.');
    else if (!scene.is_exact) notes.push('Structures are drawn as their outlines from base to top.');
    if (coverage?.by === 'field') notes.push('When a part is captured is estimated from the field; what is captured in the end is exact.');
    if (coverage?.knowsBefore === false) notes.push('What images before this flight captured appears at its end.');
    const section = document.getElementById('notes');
    section.hidden = notes.length === 0;
    const sentence = (note) => `${note[0].toUpperCase()}${note.slice(1)}${note.endsWith('.') ? '' : '.'}`;
    section.replaceChildren(...notes.map((note) => node('p', { class: 'quiet' }, sentence(note))));
}
