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
    const differing = standings(a.scene, b.scene, true);
    const count = (one) => differing.filter(({ standing }) => standing === one).length;
    const words = ['added', 'gone', 'changed'].map((one) => [STANDINGS[one], count(one)]).filter(([, times]) => times > 0);
    if (words.length > 0) section.append(node('p', { id: 'scene-differences' }, `Structures of A against B: ${words.map(([word, times]) => `${times} ${word}`).join(', ')}.`));
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
    if (!a.coverage || !b.coverage || whyApart([a, b])) return [];
    const area = (flight, other) => {
        const differences = differenceBetween(flight, other);
        return flight.coverage.surface.areas.reduce((sum, size, k) => sum + (differences[k] > 0 ? size : 0), 0);
    };
    const text = (size) => `${Math.round(size)} m²`;
    return [node('tr', {}, node('th', { scope: 'row' }, 'Only this one'), node('td', {}, text(area(a, b))), node('td', {}, text(area(b, a))), node('td', {}, ''))];
}

// How a structure of A stands to B, in words; palettes have colours of the same names.
export const STANDINGS = { added: 'new', changed: 'changed', gone: 'gone' };

// The structures that two scenes do not have in common, those of the other one as well: how A stands to B, whichever of them `scene` is.
export function standings(scene, other, isFirst) {
    if (!other || scene === other) return [];
    const theirs = new Map(other.structures.map((structure) => [structure.id, structure]));
    const mine = new Set(scene.structures.map((structure) => structure.id));
    const [own, foreign] = isFirst ? ['added', 'gone'] : ['gone', 'added'];
    const isSame = (one, two) => one.count === two.count && one.min.every((value, axis) => Math.abs(value - two.min[axis]) < 0.01 && Math.abs(one.max[axis] - two.max[axis]) < 0.01);
    const here = scene.structures.filter((one) => !theirs.has(one.id) || !isSame(one, theirs.get(one.id)));
    const ghosts = other.structures.filter(({ id }) => !mine.has(id));
    return [
        ...here.map((structure) => ({ structure, standing: theirs.has(structure.id) ? 'changed' : own, isHere: true })),
        ...ghosts.map((structure) => ({ structure, standing: foreign, isHere: false })),
    ].filter(({ structure }) => structure.kind !== 'terrain');
}

// Why what two flights capture cannot be held against each other, sample by sample.
export const whyApart = (flights) => flights.map((flight) => flight.apart).find(Boolean) ?? null;

// The boxes of structures that the shown scene does not have.
export function ghostsOf(ghosts, colours) {
    const lines = [];
    for (const { structure: { min, max } } of ghosts) {
        const corner = (k) => [k & 1 ? max[0] : min[0], k & 2 ? max[1] : min[1], k & 4 ? max[2] : min[2]];
        [[0, 1], [1, 3], [3, 2], [2, 0], [4, 5], [5, 7], [7, 6], [6, 4], [0, 4], [1, 5], [2, 6], [3, 7]].forEach((ends) => ends.forEach((k) => lines.push(...corner(k))));
    }
    const boxes = new THREE.LineSegments(new THREE.BufferGeometry(), new THREE.LineBasicMaterial());
    boxes.geometry.setAttribute('position', new THREE.Float32BufferAttribute(lines, 3));
    boxes.material.color.setRGB(...colours[ghosts[0].standing], 'srgb');
    boxes.frustumCulled = false;
    return boxes;
}
