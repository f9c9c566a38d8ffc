/** What the open session is, as the app tells it. Views draw themselves again when it changes. */

export const state = {
  about: null,
  session: null,
  photographs: new Map(),
  arriving: new Map(),
  expected: 0, // how many were to arrive when the first of those under way was chosen
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
  Object.assign(state, { activity: null, selected: null, pending: false, expected: 0 });
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

/** The photograph that the stage shows: the chosen one, else the camera's reference, else the first. */
export function onStage() {
  const { photographs: known, selected, result } = state;
  return known.get(selected) ?? known.get(result?.reference) ?? photographs()[0] ?? null;
}

/** Whether there is a result that another will take the place of, or ought to. */
export const stale = () => state.result !== null && (state.pending || outdated());

/** Whether the result is of other photographs than those that count now. */
export function outdated() {
  const used = new Set(state.result.photographs);
  return used.size !== state.session.usable.length || state.session.usable.some((id) => !used.has(id));
}

/** Whether the result is out of date and nobody is about to make another. */
export const abandoned = () => outdated() && !state.pending && !state.activity && !state.arriving.size;
