/** The state of the open session, as received from the app. Views are redrawn when it changes. */

export const state = {
  about: null,
  session: null,
  photographs: new Map(),
  arriving: new Map(),
  expected: 0, // how many uploads the current batch has in all
  result: null,
  solve: null,
  final: false,
  accepted: false,
  problem: null,
  pending: false,
  activity: null,
  selected: null,
};

const views = new Set();
let planned = false;

/** Call `view` after every change. */
export function show(view) {
  views.add(view);
}

/** Redraw all views, once for all changes of the current task. */
export function changed() {
  if (planned) return;
  planned = true;
  queueMicrotask(() => {
    planned = false;
    views.forEach((view) => view());
  });
}

export function reset() {
  Object.assign(state, { session: null, result: null, solve: null, final: false, accepted: false, problem: null });
  Object.assign(state, { activity: null, selected: null, pending: false, expected: 0 });
  state.photographs.clear();
  state.arriving.clear();
  changed();
}

/** Update the state from an event of the session. */
export function applyEvent(event) {
  switch (event.kind) {
    case "snapshot":
      state.photographs = new Map(event.photographs.map((p) => [p.id, p]));
      Object.assign(state, { session: event.session, activity: event.activity, ...resultOf(event) });
      break;
    case "session":
      state.session = event.session;
      break;
    case "photograph":
      state.photographs.set(event.photograph.id, event.photograph);
      break;
    case "removed":
      state.photographs.delete(event.id);
      break;
    case "activity":
      state.activity = event.activity;
      break;
    case "pending":
      state.pending = true;
      break;
    case "result":
      Object.assign(state, resultOf(event));
      break;
  }
  changed();
}

const resultOf = ({ result, solve, final, accepted, problem, pending }) =>
  ({ result, solve, final, accepted, problem, pending });

const byName = new Intl.Collator(undefined, { numeric: true });

/** All photographs in the natural order of their names. */
export const photographs = () => [...state.photographs.values()].sort((a, b) => byName.compare(a.name, b.name));

/** The photograph shown large: the selected one, else the camera's reference, else the first. */
export function shownPhotograph() {
  const { photographs: known, selected, result } = state;
  return known.get(selected) ?? known.get(result?.reference) ?? photographs()[0] ?? null;
}

/** Whether there is a result that is being replaced, or should be. */
export const stale = () => state.result !== null && (state.pending || outdated());

/** Whether the result was made from other photographs than those that are included now. */
export function outdated() {
  const used = new Set(state.result.photographs);
  return used.size !== state.session.usable.length || state.session.usable.some((id) => !used.has(id));
}

/** Whether the result is out of date and no other is being computed. */
export const abandoned = () => outdated() && !state.pending && !state.activity && !state.arriving.size;
