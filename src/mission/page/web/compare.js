// Two plans side by side: their figures, what only one of them captures, and structures that differ between their scenes.

import { differenceBetween } from './discs.js';
import { figuresOf, node } from './panel.js';

export function showComparison(flights, onChoose, chosen) {
    const section = document.getElementById('compare');
    section.hidden = flights.length < 2;
    if (section.hidden) return;
    const [a, b] = flights;
    const theirs = new Map(figuresOf(b).map((row) => [row.label, row]));
    const rows = figuresOf(a).filter((row) => theirs.has(row.label)).map((row) => {
        const other = theirs.get(row.label);
        return node('tr', {}, node('th', { scope: 'row' }, row.label), node('td', {}, row.text), node('td', {}, other.text), changeCell(row, other));
    });
    rows.push(...surfaceRows(a, b));
    const head = node('tr', {}, node('th', { scope: 'col' }, node('span', { class: 'hidden' }, 'Figure')), ...[`A`, `B`, 'A − B'].map((title) => node('th', { scope: 'col' }, title)));
    const name = (letter, flight) => node('li', {}, node('i', { class: letter }), node('b', {}, letter.toUpperCase()), flight.label);
    const names = node('ul', { class: 'names quiet' }, name('a', a), name('b', b));
    section.replaceChildren(node('h2', {}, 'Two plans'), names, chooser(onChoose, chosen), node('table', { class: 'compare' }, node('thead', {}, head), node('tbody', {}, ...rows)));
    const differing = sceneDifferences(a.scene, b.scene);
    const words = [['new', differing.added.length], ['gone', differing.removed.length], ['changed', differing.changed.length]].filter(([, count]) => count > 0);
    if (words.length > 0) section.append(node('p', { id: 'scene-differences' }, `Structures of A against B: ${words.map(([word, count]) => `${count} ${word}`).join(', ')}.`));
}

function chooser(onChoose, chosen) {
    const field = node('fieldset', { class: 'segments' }, node('legend', { class: 'hidden' }, 'Which plan is shown'));
    [['0', 'A'], ['1', 'B'], ['both', 'Both']].forEach(([value, text]) => {
        const input = node('input', { type: 'radio', name: 'plan', value, id: `plan-${value}` });
        input.checked = String(chosen) === value;
        input.addEventListener('change', () => onChoose(value === 'both' ? 'both' : Number(value)));
        field.append(input, node('label', { for: `plan-${value}` }, text));
    });
    return field;
}

// How A stands to B.
function changeCell({ value, better }, other) {
    const apart = value - other.value;
    if (!Number.isFinite(apart) || other.value === 0) return node('td', {}, '–');
    const isShare = other.text.endsWith('%');
    const size = isShare ? `${Math.abs(apart).toFixed(1)}` : `${Math.abs((100 * apart) / other.value).toFixed(1)} %`;
    const sign = Math.abs(apart) < 1e-9 ? '' : apart > 0 ? '+' : '−';
    const good = better * apart;
    return node('td', { class: good > 0 ? 'better' : good < 0 ? 'worse' : '' }, `${sign}${size}`);
}

function surfaceRows(a, b) {
    if (!a.coverage || !b.coverage) return [];
    const area = (flight, other) => {
        const differences = differenceBetween(flight, other);
        return flight.coverage.surface.areas.reduce((sum, size, k) => sum + (differences[k] > 0 ? size : 0), 0);
    };
    const text = (size) => `${Math.round(size)} m²`;
    return [node('tr', {}, node('th', { scope: 'row' }, 'Only this one'), node('td', {}, text(area(a, b))), node('td', {}, text(area(b, a))), node('td', {}, ''))];
}

// Structures of a scene that another one does not have, or has otherwise; and those that only the other one has.
export function sceneDifferences(scene, other) {
    if (scene === other) return { added: [], removed: [], changed: [] };
    const theirs = new Map(other.structures.map((structure) => [structure.id, structure]));
    const mine = new Set(scene.structures.map((structure) => structure.id));
    const isSame = (one, two) => one.count === two.count && one.min.every((value, axis) => Math.abs(value - two.min[axis]) < 0.01 && Math.abs(one.max[axis] - two.max[axis]) < 0.01);
    return {
        added: scene.structures.filter(({ id, kind }) => kind !== 'terrain' && !theirs.has(id)),
        changed: scene.structures.filter((one) => one.kind !== 'terrain' && theirs.has(one.id) && !isSame(one, theirs.get(one.id))),
        removed: other.structures.filter(({ id, kind }) => kind !== 'terrain' && !mine.has(id)),
    };
}

// The boxes of structures that are gone.
export function ghostsOf(structures, colours) {
    const lines = [];
    for (const { min, max } of structures) {
        const corner = (k) => [k & 1 ? max[0] : min[0], k & 2 ? max[1] : min[1], k & 4 ? max[2] : min[2]];
        [[0, 1], [1, 3], [3, 2], [2, 0], [4, 5], [5, 7], [7, 6], [6, 4], [0, 4], [1, 5], [2, 6], [3, 7]].forEach((ends) => ends.forEach((k) => lines.push(...corner(k))));
    }
    const ghosts = new THREE.LineSegments(new THREE.BufferGeometry(), new THREE.LineBasicMaterial());
    ghosts.geometry.setAttribute('position', new THREE.Float32BufferAttribute(lines, 3));
    ghosts.material.color.setRGB(...colours.gone, 'srgb');
    ghosts.frustumCulled = false;
    return ghosts;
}
