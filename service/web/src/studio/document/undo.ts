/**
 * Undo and redo without limit. States are immutable values that share their unchanged parts, so that a step costs the
 * changed path only, and undoing restores the very same value.
 */

interface Step<State> {
  /** Description of the change, for example "Brush stroke". */
  label: string;
  before: State;
  after: State;
  /** Successive steps with the same non-empty group are one if they follow soon enough, for example one slider drag. */
  group: string;
  /** Milliseconds, on any clock that grows. */
  at: number;
}

export interface History<State> {
  readonly present: State;
  readonly past: readonly Step<State>[];
  readonly future: readonly Step<State>[];
}

export const GROUP_MS = 1000;

/** For groups of which each belongs to one drag of the pointer: the drag is one step, however long it pauses. */
export const DRAG_MS = Number.POSITIVE_INFINITY;

export const startHistory = <State>(present: State): History<State> => ({ present, past: [], future: [] });

export interface StepOptions {
  group?: string;
  at?: number;
  /** Most milliseconds between two steps of a group that are one. */
  within?: number;
}

/** The history after a change. An equal state does not change it. */
export function record<State>(
  history: History<State>,
  label: string,
  after: State,
  { group = "", at = 0, within = GROUP_MS }: StepOptions = {},
): History<State> {
  if (after === history.present) return history;
  const last = history.past.at(-1);
  if (last && group && last.group === group && at - last.at <= within) {
    return { present: after, past: [...history.past.slice(0, -1), { ...last, after, at }], future: [] };
  }
  return { present: after, past: [...history.past, { label, before: history.present, after, group, at }], future: [] };
}

export function undo<State>(history: History<State>): History<State> {
  const step = history.past.at(-1);
  if (!step) return history;
  return { present: step.before, past: history.past.slice(0, -1), future: [step, ...history.future] };
}

export function redo<State>(history: History<State>): History<State> {
  const [step, ...rest] = history.future;
  if (!step) return history;
  return { present: step.after, past: [...history.past, step], future: rest };
}

/**
 * Change the present state without a step, for facts that are no decision of the user: for example the asset id of a picture
 * that has just been uploaded. Steps keep their states, which `rewrite` changes as well.
 */
export function rewrite<State>(history: History<State>, change: (state: State) => State): History<State> {
  const changed = new Map<State, State>();
  const once = (state: State): State => {
    const known = changed.get(state) ?? change(state);
    changed.set(state, known);
    return known;
  };
  const steps = (list: readonly Step<State>[]) =>
    list.map((step) => ({ ...step, before: once(step.before), after: once(step.after) }));
  return { present: once(history.present), past: steps(history.past), future: steps(history.future) };
}
