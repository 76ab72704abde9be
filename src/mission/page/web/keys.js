// The keyboard. Within the view arrows turn the camera; everywhere else they move through time.

const isTyping = (target) => target.matches('input:not([type=range]):not([type=radio]):not([type=checkbox]), select, textarea, [contenteditable]');

export function listenToKeys({ timeline, stage, pointer, layers, actions, hasPlan }) {
    document.addEventListener('keydown', (event) => {
        const { key, target } = event;
        if (event.ctrlKey || event.metaKey || event.altKey || isTyping(target) || document.querySelector('dialog[open]')) return;
        if (!hasPlan() && !'t?'.includes(key)) return;
        const isInView = target === stage?.canvas;
        const handled = (isInView && viewKey(event, stage, pointer)) || timeKey(event, timeline, actions) || letterKey(key, { timeline, layers, actions });
        if (handled) event.preventDefault();
    });
}

function viewKey({ key, shiftKey }, stage, pointer) {
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[key];
    if (step && shiftKey) stage.pan(...step);
    else if (step) stage.turn(-5 * step[0], 4 * step[1]);
    else if (key === '+' || key === '=') stage.zoom(0.85);
    else if (key === '-') stage.zoom(1.18);
    else if (key === 'Enter') pointer.choose(stage.canvas.clientWidth / 2, stage.canvas.clientHeight / 2);
    else return false;
    return true;
}

function timeKey({ key, shiftKey, target }, timeline, actions) {
    const isButton = target.matches('button, summary, a, input[type=radio], input[type=checkbox]');
    const isChoice = target.matches('input[type=radio]');
    if (key === ' ' && !isButton) timeline.play(!timeline.isPlaying);
    else if ((key === 'ArrowLeft' || key === 'ArrowRight') && !isChoice) timeline.go(timeline.time + (key === 'ArrowLeft' ? -1 : 1) * (shiftKey ? 10 : 1));
    else if (key === 'Home') timeline.go(0);
    else if (key === 'End') timeline.go(timeline.duration);
    else if (key === '[' || key === ']') actions.image(key === '[' ? -1 : 1);
    else return false;
    return true;
}

function letterKey(key, { timeline, layers, actions }) {
    const act = {
        p: () => timeline.play(!timeline.isPlaying),
        c: () => layers.cycle('coverage', layers.modes),
        f: () => layers.cycle('frusta', ['current', 'all', 'none']),
        s: () => layers.cycle('colour', ['speed', 'time']),
        w: () => layers.set('waypoints', !layers.state.waypoints),
        m: actions.measure,
        t: actions.theme,
        r: actions.home,
        v: actions.above,
        a: actions.switchPlan,
        '?': actions.help,
    }[key];
    act?.();
    return act !== undefined;
}
