/** What the open session is, as the app tells it. Views draw themselves again when it changes. */

export const state = {
  about: null,
  session: null,
  photographs: new Map(),
  arriving: new Map(),
  result: null,
  solve: null,
  final: false,
  accepted: false,
  problem: null,
  activity: null,
  selected: null,
};

const views = new Set();
let planned = false;

/** Call `view` after every change. */
export function show(view) {
  views.add(view);
}

/** Draw all views again, once for all changes up to the next frame. */
export function changed() {
  if (planned) return;
  planned = true;
  queueMicrotask(() => {
    planned = false;
    views.forEach((view) => view());
  });
}

export function forget() {
  Object.assign(state, { session: null, result: null, solve: null, final: false, accepted: false, problem: null });
  Object.assign(state, { activity: null, selected: null });
  state.photographs.clear();
  state.arriving.clear();
  changed();
}

/** Take in one event of the session. */
export function heard(event) {
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
    case "result":
      Object.assign(state, resultOf(event));
      break;
  }
  changed();
}

const resultOf = ({ result, solve, final, accepted, problem }) => ({ result, solve, final, accepted, problem });

const byName = new Intl.Collator(undefined, { numeric: true });

/** All photographs in the natural order of their names. */
export const photographs = () => [...state.photographs.values()].sort((a, b) => byName.compare(a.name, b.name));

/** The photograph that the stage shows: the chosen one, else the camera's reference, else the first. */
export function onStage() {
  const { photographs: known, selected, result } = state;
  return known.get(selected) ?? known.get(result?.reference) ?? photographs()[0] ?? null;
}

/** Whether the result is of other photographs than those that count now. */
export function stale() {
  return state.result !== null && (!state.final || state.activity?.solving === true || outdated());
}

/** Whether the result, which nobody is working on, is not of the photographs that count now. */
export function outdated() {
  if (!state.result || state.activity) return false;
  const used = new Set(state.result.photographs);
  return used.size !== state.session.usable.length || state.session.usable.some((id) => !used.has(id));
}
