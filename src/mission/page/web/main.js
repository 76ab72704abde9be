// Puts the page together. `window.overfly` is what programs around it use: `show(data)` replaces what is shown, `pick(id)` picks a structure,
// `onPick(callback)` tells what is picked.

import { INSTANT_S, capturedPercent, clockText, countUpTo, distanceOf, droneAt, imagesAt, lengthText, modelOf, stepsAlong } from './model.js';
import { chooseTheme, followTheme, palette, themeName } from './theme.js';
import { Structures, distanceToBox } from './structures.js';
import { Surroundings, niceLength } from './surroundings.js';
import { Drone, Route } from './route.js';
import { Frusta } from './frusta.js';
import { Discs } from './discs.js';
import { Stage, canDraw } from './stage.js';
import { Pointer } from './pointer.js';
import { Charts } from './charts.js';
import { Timeline } from './timeline.js';
import { showFigures, showHeading, showNotes, showPicked, showSorties, showTable } from './panel.js';
import { STANDINGS, ghostsOf, showComparison, standings, whyApart } from './compare.js';
import { Layers } from './layers.js';
import { listenToKeys } from './keys.js';

const byId = (id) => document.getElementById(id);
const state = { coverage: 'final', colour: 'speed', frusta: 'current', waypoints: false, zones: true, ceiling: false, edges: true, plan: 0 };
const labels = new Map();
const pickers = [];
// Between places of a path at which its distance from something is taken, m.
const PATH_STEP_M = 2;
// How long after a change the picked structure is described anew.
const AFTER_PICTURE_MS = 60;
let model = null;
let stage = null;
let pointer = null;
let world = null;
// By its id, because a plan brings structures of its own; and the one of the scene that is shown, if it has it.
let chosenId = null;
let picked = null;
let describing = null;

window.overfly = {
    show,
    pick: pickById,
    onPick: (callback) => pickers.push(callback),
    state: told,
    look: (view) => stage?.look(view),
    view: () => stage?.view(),
    stage: () => stage,
    at: (x, y) => pointer?.at(x, y),
    nearest,
};

const charts = new Charts(byId('charts'), (time) => timeline.go(time));
const timeline = new Timeline({ slider: byId('slider'), button: byId('play'), rate: byId('rate'), clock: byId('clock'), status: byId('where') }, follow);
timeline.describe = (time) => {
    if (!model) return '';
    const drone = droneAt(shown(), time);
    const captured = capturedPercent(shown(), time);
    const covered = captured === null ? '' : `, ${captured.toFixed(1)} percent captured`;
    const height = `${drone.position[2].toFixed(0)} metres ${shown().scene.terrain ? 'above the lowest ground' : 'high'}`;
    return `${clockText(time)}: ${height}, ${drone.speed.toFixed(1)} metres per second${covered}`;
};
const layers = new Layers(state, (key) => {
    if (key === 'colour') paintRoutes();
    refresh();
});
timeline.onPlay = () => layers.playing();
// A live page may have no plan yet.
const withPlan = (act) => (...given) => model && act(...given);
const actions = {
    image: withPlan(jumpByImage),
    measure: withPlan(toggleMeasuring),
    theme: switchTheme,
    home: withPlan(() => stage?.home()),
    above: withPlan(() => stage?.above()),
    switchPlan: withPlan(switchPlan),
    help: () => byId('help').showModal(),
};

start();

function start() {
    followTheme(paint);
    const drawing = canDraw();
    if (drawing) {
        try {
            stage = new Stage(byId('canvas'), byId('overlay'), drawing);
        } catch (error) {
            console.warn(`WebGL: ${error.message}`);
        }
    }
    document.documentElement.classList.toggle('flat', stage === null);
    byId('fallback').hidden = stage !== null;
    if (stage) {
        pointer = new Pointer({ stage, tip: byId('tip'), world: () => world, onPick: pick });
        stage.scene.add(pointer.group);
        stage.beforeDrawing.push(showInstruments);
    }
    [['home', actions.home], ['above', actions.above], ['measure', actions.measure], ['theme', actions.theme], ['help-button', actions.help]].forEach(([id, act]) => byId(id).addEventListener('click', act));
    listenToKeys({ timeline, stage, pointer, layers, actions, hasPlan: () => model !== null });
    byId('time').inert = true;
    show(JSON.parse(byId('data').textContent));
}

function shown() {
    return model.flights[state.plan === 'both' ? 0 : state.plan];
}

// Replaces what is shown; the camera stays where it is, and time where it is in the flight.
function show(data) {
    // A program that serves the page may have no plan yet.
    if (data.flights.length === 0) return;
    const share = timeline.share();
    const isFirst = model === null;
    model = modelOf(data, model);
    byId('time').inert = false;
    if (state.plan !== 'both' && state.plan >= model.flights.length) state.plan = 0;
    if (isFirst && model.flights.length > 1) state.plan = 'both';
    timeline.play(false);
    allow();
    if (isFirst && layers.modes.includes('difference')) layers.set('coverage', 'difference');
    build();
    if (isFirst) stage?.home();
    else stage?.hurry();
    timeline.setDuration(Math.max(...model.flights.map((flight) => flight.duration_s)), share);
    byId('structures-table').open ||= stage === null;
}

// What can be looked at in the plan that is shown.
function allow() {
    const { scene } = shown();
    layers.allow({
        hasCoverage: model.flights.every((flight) => flight.coverage),
        canDiffer: model.flights.length > 1 && whyApart(model.flights) === null,
        hasZones: scene.zones.length > 0,
        hasCeiling: Boolean(scene.ceiling_m) && !scene.terrain,
    });
}

// What stands on the stage for the plan that is shown.
function build() {
    const flight = shown();
    picked = structureOf(chosenId);
    const isComparing = model.flights.length > 1;
    showHeading(flight);
    showFigures(flight);
    byId('figures').hidden = isComparing;
    showComparison(model.flights, choosePlan, state.plan);
    showSorties(flight, (time) => timeline.go(time));
    showNotes(model.flights, flight, whyApart(model.flights));
    showTable(flight);
    const ordered = state.plan === 1 ? [model.flights[1], model.flights[0]] : model.flights;
    charts.show(ordered, Math.max(...model.flights.map((one) => one.duration_s)));
    if (stage) buildWorld(flight);
    paint();
}

function buildWorld(flight) {
    const { scene } = flight;
    const bounds = union([...model.flights.map((one) => one.bounds), ...(scene.structures.length > 0 ? [{ min: scene.min_m, max: scene.max_m }] : [])]);
    const isNewScene = world?.scene !== scene;
    if (world) {
        stage.scene.remove(world.group);
        if (!isNewScene) world.group.remove(world.structures.group);
        stage.retire(world.group);
    }
    const other = model.flights.find((one) => one !== flight);
    const structures = isNewScene ? new Structures(scene) : world.structures;
    const surroundings = new Surroundings(scene, bounds, (place) => structures.groundAt(place));
    const drawn = model.flights.filter((one) => state.plan === 'both' || one === flight);
    const routes = drawn.map((one) => new Route(one, model.flights.indexOf(one) === 1 && state.plan === 'both'));
    // Colours and words say how A stands to B, also where B is shown.
    const isFirst = flight === model.flights[0];
    const discs = flight.coverage ? new Discs(flight, layers.modes.includes('difference') ? other : null, isFirst ? 1 : -1) : null;
    const differing = standings(scene, other?.scene, isFirst);
    const group = new THREE.Group();
    const drones = drawn.map(() => new Drone());
    const frusta = new Frusta(flight);
    group.add(surroundings.group, structures.group, frusta.group, ...routes.map((route) => route.group), ...drones.map((drone) => drone.group));
    if (discs) group.add(discs.mesh);
    const ghosts = differing.filter(({ isHere }) => !isHere);
    if (ghosts.length > 0) group.add(ghostsOf(ghosts, palette()));
    world = {
        scene, flight, group, structures, surroundings, routes, discs, drones, frusta, drawn, differing,
        describe: (structure) => describe(structure),
        label: setLabels,
        say: (text) => { byId('say').textContent = text; },
    };
    stage.scene.add(group);
    stage.frame(bounds);
    const prefix = (index) => (state.plan === 'both' ? `${'AB'[index]} ` : '');
    setLabels('routes', merged(routes.flatMap((route, index) => route.labels(prefix(index)))));
    setLabels('differing', differenceLabels(differing));
}

function union(boxes) {
    const pick3 = (key, choose) => [0, 1, 2].map((axis) => choose(...boxes.map((box) => box[key][axis])));
    return { min: pick3('min', Math.min).map((value, axis) => (axis === 2 ? Math.min(value, 0) : value)), max: pick3('max', Math.max) };
}

// Labels of the same kind at one place become one: "A, B start".
function merged(list) {
    return list.reduce((kept, label) => {
        const same = kept.find((one) => distanceOf(one.at, label.at) < 0.05 * stage.radius && one.text.slice(1) === label.text.slice(1));
        if (same) same.text = `${same.text[0]}, ${label.text}`;
        return same ? kept : [...kept, label];
    }, []);
}

// Names at the structures that differ from the other plan's scene; where these are many the colours have to do.
function differenceLabels(differing) {
    if (differing.length > 12) return [];
    const top = ({ min, max }) => [(min[0] + max[0]) / 2, (min[1] + max[1]) / 2, max[2]];
    return differing.map(({ structure, standing }) => ({ at: top(structure), text: `${structure.name}: ${STANDINGS[standing]}`, kind: 'changed' }));
}

function setLabels(owner, list) {
    labels.set(owner, list);
    stage.setLabels([...labels.values()].flat());
}

function paint() {
    if (!model) return;
    byId('theme').setAttribute('aria-label', themeName() === 'dark' ? 'Light colours' : 'Dark colours');
    layers.legend(shown(), palette());
    if (world) {
        const colours = palette();
        world.structures.tints.fill(null);
        const here = world.differing.filter(({ isHere }) => isHere);
        here.forEach(({ structure, standing }) => { world.structures.tints[structure.index] = colours[standing]; });
        if (picked) world.structures.tints[picked.index] = colours.selected;
        [world.structures, world.surroundings, world.frusta, world.discs, ...world.drones].forEach((part) => part?.paint(colours));
        paintRoutes();
    }
    refresh();
}

function paintRoutes() {
    world?.routes.forEach((route) => route.paint(palette(), state.colour));
}

// What the switches say.
function refresh() {
    if (!model) return;
    layers.legend(shown(), palette());
    if (world) {
        world.routes.forEach((route) => { route.waypoints.visible = state.waypoints; });
        world.frusta.current.visible = state.frusta !== 'none';
        world.frusta.all.visible = state.frusta === 'all';
        world.surroundings.zones.visible = state.zones;
        if (world.surroundings.ceiling) world.surroundings.ceiling.visible = state.ceiling;
        world.structures.edges.visible = state.edges;
        setLabels('zones', state.zones ? world.surroundings.labels() : []);
    }
    follow(timeline.time);
}

// Everything that time moves.
function follow(time) {
    if (!model) return;
    charts.follow(time);
    if (!world) return;
    world.discs?.show(state.coverage, time);
    world.drawn.forEach((flight, index) => {
        const drone = droneAt(flight, time);
        const below = world.structures.meet(drone.position, [0, 0, -1])?.distance ?? drone.position[2];
        world.drones[index].place(drone, below, Math.max(3, 0.022 * stage.distance()));
    });
    if (state.frusta !== 'none') world.frusta.show(imagesAt(world.flight, time), sight);
    stage.invalidate();
    describeSoon();
}

// What is to be known of the picked structure comes after the picture: to find out how far the path is from it takes longer than all that moves.
function describeSoon() {
    describing ??= setTimeout(() => {
        describing = null;
        showPicked(picked && describe(picked));
    }, AFTER_PICTURE_MS);
}

// How far a ray goes to a structure or the ground.
function sight(from, towards) {
    const met = world.structures.meet(from, towards)?.distance ?? Infinity;
    const ground = towards[2] < 0 && !world.scene.terrain ? -from[2] / towards[2] : Infinity;
    return Math.min(met, ground);
}

function describe(structure) {
    const { flight, structures } = world;
    const lines = [structure.name];
    if (structure.kind === 'terrain') return ['Ground'];
    lines.push(`${(structure.top_m - structure.base_m).toFixed(1)} m tall, from ${structure.base_m.toFixed(1)} to ${structure.top_m.toFixed(1)} m`);
    const tally = flight.coverage?.tallies[structure.index];
    if (structure.kind === 'obstacle') lines.push('An obstacle: flown around, not captured');
    else if (tally?.capturable) lines.push(`${((100 * tally.captured) / tally.capturable).toFixed(0)} % captured of what can be (${tally.capturable} of ${tally.exposed} samples)`);
    else if (tally) lines.push(tally.exposed ? 'Out of reach of this rig, or not ordered' : 'Nothing of it lies open');
    lines.push(`${lengthText(structures.distanceTo(structure, droneAt(flight, timeline.time).position))} from the drone now, ${lengthText(pathDistance(structure))} from the path`);
    return lines;
}

// The nearest the path comes to a structure, to a decimetre. What has been found out is kept.
function pathDistance(structure) {
    const { flight, structures } = world;
    flight.distances ??= new Map();
    if (!flight.distances.has(structure.id)) {
        flight.steps ??= stepsAlong(flight, PATH_STEP_M);
        const near = flight.steps.map((place) => [distanceToBox(place, structure), place]).sort((a, b) => a[0] - b[0]);
        let least = Infinity;
        for (const [atLeast, place] of near) {
            if (atLeast >= least) break;
            least = structures.distanceTo(structure, place, least);
        }
        flight.distances.set(structure.id, least);
    }
    return flight.distances.get(structure.id);
}

// The least distance of the path to any structure, m.
function nearest() {
    return Math.min(...world.scene.structures.filter(({ kind }) => kind !== 'terrain').map(pathDistance));
}

function pick(structure, point) {
    const colours = palette();
    if (picked && world) world.structures.tint(picked.index, tintOf(picked, colours));
    picked = structure?.kind === 'terrain' ? null : structure;
    chosenId = picked?.id ?? null;
    if (picked && world) world.structures.tint(picked.index, colours.selected);
    const told = picked && world && describe(picked);
    showPicked(told);
    timeline.say(told?.join(', ') ?? '');
    stage?.invalidate();
    const { id, name, kind, base_m, top_m } = picked ?? {};
    pickers.forEach((callback) => callback(picked ? { id, name, kind, base_m, top_m, point } : null));
}

// Also one that only the plan to come has.
function pickById(id) {
    pick(structureOf(id), null);
    chosenId = id;
}

// The structure with an id in the scene that is shown.
function structureOf(id) {
    return (model && shown().scene.structures.find((structure) => structure.id === id)) ?? null;
}

function tintOf(structure, colours) {
    const differing = world.differing.find((one) => one.structure === structure);
    return differing ? colours[differing.standing] : null;
}

function choosePlan(plan) {
    state.plan = plan;
    allow();
    build();
    follow(timeline.time);
}

function switchPlan() {
    if (model.flights.length > 1) choosePlan({ 0: 1, 1: 'both', both: 0 }[state.plan]);
}

function jumpByImage(step) {
    const { times } = shown().images;
    const taken = countUpTo(times, timeline.time + INSTANT_S);
    const now = taken > 0 ? times[taken - 1] : -Infinity;
    const next = step > 0 ? times.find((time) => time > Math.max(now, timeline.time) + INSTANT_S) : times.findLast((time) => time < now - INSTANT_S);
    if (next !== undefined) timeline.go(next);
}

function toggleMeasuring() {
    if (!pointer) return;
    pointer.startMeasuring(!pointer.isMeasuring);
    byId('measure').setAttribute('aria-pressed', String(pointer.isMeasuring));
    document.documentElement.classList.toggle('measuring', pointer.isMeasuring);
    if (pointer.isMeasuring) byId('canvas').focus({ preventScroll: true });
}

function switchTheme() {
    chooseTheme(themeName() === 'dark' ? 'light' : 'dark', paint);
}

// Which way north is, and how long a metre is where the camera looks at.
function showInstruments() {
    byId('needle').style.transform = `rotate(${(-stage.view().azimuth).toFixed(1)}deg)`;
    const pixels = stage.canvas.clientHeight / (2 * Math.tan((stage.camera.fov * Math.PI) / 360) * stage.distance());
    const metres = niceLength(60 / pixels);
    byId('scale').style.width = `${(metres * pixels).toFixed(1)}px`;
    byId('scale').textContent = metres < 1000 ? `${metres} m` : `${metres / 1000} km`;
    const size = Math.max(3, 0.022 * stage.distance());
    world?.drones.forEach((drone) => drone.body.scale.setScalar(size));
}

// For programs and tests: what is shown now.
function told() {
    const flight = model && shown();
    const { time } = timeline;
    return {
        time_s: time,
        duration_s: timeline.duration,
        is_playing: timeline.isPlaying,
        drone_m: flight && droneAt(flight, time).position,
        captured_percent: flight && capturedPercent(flight, time),
        images: flight ? imagesAt(flight, time) : [],
        theme: themeName(),
        picked: picked?.id ?? null,
        measured: pointer?.result ?? null,
        frames: stage?.frames ?? 0,
        has_picture: stage !== null,
        first_frame_ms: window.overfly.firstFrame ?? null,
        structures: flight?.scene.structures.length ?? 0,
        ...state,
    };
}
