// The live side of the page: plans as the daemon publishes them, edits of what was picked, and what the connection is like.

{
    const room = document.getElementById('live');
    const { token } = JSON.parse(document.getElementById('live-settings').textContent);

    const PHASES = {
        connecting: 'looking for the daemon…',
        lost: 'daemon lost, reconnecting…',
        unloaded: 'waiting for the scene to be loaded…',
        idle: 'live',
        building: 'live: looking at what has changed…',
        planning: 'live: searching for a better path…',
        unheard: 'the server of this page does not answer, trying again…',
    };

    const STYLE = `
        #live { display: grid; gap: 8px; }
        #live ul { margin: 0; padding: 0; }
        #live h3 { margin: 0; font-size: 13px; }
        #live form { display: flex; flex-wrap: wrap; gap: 6px; align-items: center; }
        #live section { display: grid; gap: 4px; padding-top: 8px; border-top: 1px solid var(--hairline); }
        #live input { font: inherit; color: inherit; background: var(--paper); border: 1px solid var(--quiet); border-radius: 7px; padding: 4px 8px; }
        #live input[type=search] { flex: 1; min-width: 0; }
        #live input[type=number] { width: 60px; }
        #live li { display: flex; justify-content: space-between; gap: 6px; align-items: center; list-style: none; }
        #live [role=alert] { border-left: 3px solid var(--worse); padding-left: 8px; color: var(--worse); }
        #live p:first-of-type::before { content: "● "; color: var(--better); }
        #live:is([data-phase=lost], [data-phase=unheard], [data-phase=unloaded], [data-phase=connecting]) p:first-of-type::before { color: var(--worse); }
        #live :is(p, ul):empty { display: none; }`;

    const make = (tag, attributes, ...children) => {
        const made = Object.assign(document.createElement(tag), attributes);
        made.append(...children);
        return made;
    };
    const button = (text, act) => make('button', { type: 'button', textContent: text, onclick: act });
    const line = (role) => {
        const made = make('p', {});
        made.setAttribute('role', role);
        return made;
    };

    const connection = line('status');
    const progress = line('status');
    const refused = line('alert');
    const danger = line('alert');

    // Whatever can be clicked can be found by its name as well.
    const names = make('datalist', { id: 'live-names' });
    const search = make('input', { id: 'live-search', type: 'search', autocomplete: 'off' });
    search.setAttribute('list', 'live-names');
    const finder = make(
        'form', {},
        make('label', { htmlFor: 'live-search', textContent: 'Building' }), search, names, make('button', { type: 'submit', textContent: 'Choose' }),
    );
    const chosen = make('section', { hidden: true });
    chosen.setAttribute('aria-labelledby', 'live-title');
    const removed = make('ul', {});
    removed.setAttribute('aria-label', 'Removed buildings');
    room.append(make('style', { textContent: STYLE }), connection, danger, finder, chosen, removed, progress, refused);

    const state = {
        run: null, // of the server
        isHeard: false,
        status: { phase: 'connecting', remark: null, revision: null, removed: [] },
        structures: [],
        names: '', // of them
        picked: null, // id
        by: 15, // m
        heard: null, // the newest plan that is not drawn yet, as it came
        isDrawing: false,
        shown: { revision: 0, at: 0, hasPath: false },
        edit: null, // whose path has not come yet
        coverage: null, // how it was looked at before a path came without
    };

    // The daemon reads ids in hexadecimal, the page's data have them in decimal digits.
    const idOf = (structure) => BigInt(structure.id).toString(16).padStart(16, '0');

    function tellConnection() {
        const { phase, remark, revision } = state.isHeard ? state.status : { phase: 'unheard' };
        const parts = [PHASES[phase], revision && `revision ${revision}`].filter(Boolean).join(', ');
        connection.textContent = remark ? `${parts} (${remark})` : parts;
        room.dataset.phase = phase;
    }

    function tellNames() {
        const known = state.structures.map(({ name }) => name).join('\n');
        if (state.names === known) return;
        state.names = known;
        names.replaceChildren(...state.structures.map(({ name }) => make('option', { value: name })));
    }

    function tellRemoved() {
        // A button that has the focus stays while its building does.
        const ids = state.status.removed.map(({ id }) => id).join();
        if (removed.dataset.ids === ids) return;
        removed.dataset.ids = ids;
        removed.replaceChildren(...state.status.removed.map(({ id, name }) => {
            const back = button('Put back', () => edit({ edit: 'restore', structure: id }, `${name} is put back`));
            back.setAttribute('aria-label', `Put ${name} back`);
            return make('li', {}, make('span', { textContent: `${name}, removed` }), back);
        }));
    }

    function tellChosen() {
        const structure = state.structures.find((one) => one.id === state.picked);
        chosen.hidden = !structure;
        room.dataset.picked = structure?.name ?? '';
        if (!structure) {
            chosen.replaceChildren();
            return;
        }
        const height = `${(structure.top_m - structure.base_m).toFixed(1)} m high, top at ${structure.top_m.toFixed(1)} m`;
        // What is typed, or has the focus, at the moment stays.
        const told = chosen.querySelector('output');
        if (told && chosen.dataset.id === structure.id) {
            told.textContent = height;
            return;
        }
        chosen.dataset.id = structure.id;
        const { name } = structure;
        const by = make('input', { id: 'live-by', type: 'number', min: '0.1', max: '500', step: 'any', value: String(state.by), required: true });
        const change = (kind, word) => {
            if (!by.reportValidity()) return;
            state.by = by.valueAsNumber;
            edit({ edit: kind, structure: idOf(structure), by_m: state.by }, `${name} is ${word} by ${state.by} m`);
        };
        const form = make(
            'form', {},
            make('label', { htmlFor: 'live-by', textContent: 'By, m' }), by, make('button', { type: 'submit', textContent: 'Raise' }),
            button('Lower', () => change('lower', 'lowered')),
            button('Remove', () => edit({ edit: 'remove', structure: idOf(structure) }, `${name} is removed`)),
        );
        form.onsubmit = (event) => {
            event.preventDefault();
            change('raise', 'raised');
        };
        chosen.replaceChildren(make('h3', { id: 'live-title', textContent: name }), make('output', { textContent: height }), form);
    }

    finder.onsubmit = (event) => {
        event.preventDefault();
        const wanted = search.value.trim().toLowerCase();
        const called = (fits) => state.structures.find((one) => fits(one.name.toLowerCase()));
        const found = wanted && (called((name) => name === wanted) ?? called((name) => name.includes(wanted)));
        refused.textContent = found ? '' : `There is no building called “${search.value}”.`;
        if (!found) return;
        // The page is told as well: what is picked there comes back with every plan.
        window.overfly.pick(found.id);
        state.picked = found.id;
        tellChosen();
        chosen.querySelector('input').focus();
    };

    async function edit(order, words) {
        const mine = { clicked: performance.now(), words, revision: null };
        state.edit = mine;
        room.dataset.edit = 'waiting';
        refused.textContent = '';
        progress.textContent = `${words}: replanning…`;
        const answer = await ask(order);
        if (order.edit === 'remove' && answer.can_be_restored === false) mine.words += ' and cannot be put back from here';
        if (answer.error) {
            refused.textContent = `Not done: ${answer.error}`;
            end(mine, 'refused', '');
        } else if (!answer.replan_follows) {
            end(mine, 'made', `${words}; no plan follows, because the scene has not been planned yet`);
        } else {
            mine.revision = answer.revision;
            settle();
        }
    }

    async function ask(order) {
        const headers = { 'content-type': 'application/json', 'x-overfly-token': token };
        try {
            const response = await fetch('edits', { method: 'POST', headers, body: JSON.stringify(order) });
            return await response.json();
        } catch {
            return { error: 'the server of this page does not answer' };
        }
    }

    // A later edit has taken the place of one that it ended.
    function end(mine, how, words) {
        if (state.edit !== mine) return;
        state.edit = null;
        room.dataset.edit = how;
        progress.textContent = words;
    }

    // The path that an edit leads to may be here before the daemon's word that the edit was made.
    function settle() {
        const { edit: mine, shown } = state;
        if (!mine || mine.revision === null || shown.revision < mine.revision) return;
        if (!shown.hasPath) {
            end(mine, 'made', `${mine.words}; there is no path`);
            return;
        }
        const latency = Math.max(0, shown.at - mine.clicked);
        room.dataset.latencyMs = latency.toFixed(1);
        end(mine, 'shown', `${mine.words}: new path after ${latency.toFixed(0)} ms`);
    }

    function show() {
        const newest = JSON.parse(state.heard);
        state.heard = null;
        const { flights } = newest.page;
        if (flights.length > 0) {
            // A path comes before what it captures is known; how that is looked at comes back with it.
            const isKnown = flights.every((flight) => flight.coverage);
            if (!isKnown && state.shown.revision > 0) state.coverage ??= window.overfly.state().coverage;
            window.overfly.show(newest.page);
            if (isKnown && state.coverage) {
                document.querySelector(`[data-layer=coverage][value=${state.coverage}]:enabled:not(:checked)`)?.click();
                state.coverage = null;
            }
        }
        state.structures = newest.page.scenes[0].structures.filter((one) => one.kind !== 'terrain');
        tellNames();
        tellChosen();
        danger.textContent = dangerOf(newest);
        // The next frame has it on the screen; a page in the background draws none.
        const drawn = () => {
            state.shown = { revision: newest.revision, at: performance.now(), hasPath: newest.epoch !== null };
            Object.assign(room.dataset, { revision: newest.revision, epoch: newest.epoch ?? '', interim: newest.is_interim });
            settle();
            state.isDrawing = state.heard !== null;
            if (state.isDrawing) begin();
        };
        if (document.hidden) drawn();
        else requestAnimationFrame(() => setTimeout(drawn));
    }

    // What cannot be shown does not hold up what comes after it.
    function begin() {
        try {
            show();
        } catch (error) {
            state.isDrawing = false;
            throw error;
        }
    }

    function dangerOf({ infeasible, page }) {
        if (infeasible) return `There is no flight; do not fly the plan before: ${infeasible}`;
        return page.flights.length > 0 ? '' : 'The scene has not been planned yet; order a plan with “overfly plan”. A flight that is still shown is not of this scene.';
    }

    const events = new EventSource('events');
    const hear = (isHeard) => {
        state.isHeard = isHeard;
        tellConnection();
    };
    events.onopen = () => hear(true);
    events.onerror = () => hear(false);
    events.addEventListener('hello', (event) => {
        const { run } = JSON.parse(event.data);
        // A server that was started anew takes another token.
        if (state.run !== null && state.run !== run) window.location.reload();
        state.run = run;
    });
    events.addEventListener('status', (event) => {
        state.status = JSON.parse(event.data);
        tellConnection();
        tellRemoved();
        // Whoever was to send the path is gone.
        const { edit: waiting, status: { phase } } = state;
        if (waiting && ['lost', 'unloaded'].includes(phase)) end(waiting, 'lost', `${waiting.words}: the daemon was lost before a new path came`);
    });
    events.addEventListener('show', (event) => {
        // When plans come faster than they are drawn, only the newest is; but one that has been begun is drawn.
        state.heard = event.data;
        if (state.isDrawing) return;
        state.isDrawing = true;
        setTimeout(begin);
    });
    window.overfly.onPick((structure) => {
        state.picked = structure?.id ?? null;
        tellChosen();
    });
    tellConnection();
}
