/** The first project's lesson: what to do next, ticked off as the user does it. */

import { computed, type ReadonlySignal } from "@preact/signals";
import { useMemo } from "preact/hooks";
import { Icon, IconButton } from "../../ui/icons";
import { picturesOf } from "../document/document";
import { PAINT_TOOLS, pictureAt, type Store } from "../state/store";

/** Value of `ui.lesson` of a project that has this lesson. */
const KEYS_LESSON = "keys";

export interface LessonState {
  painting: boolean;
  keys: number;
  neighbours: number;
}

interface LessonStep {
  text: string;
  done(state: LessonState): boolean;
}

const STEPS: LessonStep[] = [
  { text: "Press “Paint frame” in the panel.", done: ({ painting, keys }) => painting || keys > 0 },
  { text: "Draw over the picture, for example around the sun. This frame is now a key.", done: ({ keys }) => keys > 0 },
  { text: "Wait a moment: the frames around it follow your strokes.", done: ({ neighbours }) => neighbours > 1 },
  {
    text: "Go to another frame, press “Paint frame” again and draw: a second key. The film changes from one to the other.",
    done: ({ keys }) => keys > 1,
  },
];

/** How many of the steps are done, in their order: a step counts only after all before it. */
export function stepsDone(state: LessonState, before = 0): number {
  let done = before;
  while (STEPS[done]?.done(state)) done++;
  return done;
}

export function Lesson({ store }: { store: Store }) {
  const progress = useMemo(() => trackProgress(store), [store]);
  if (store.document.value.ui?.lesson !== KEYS_LESSON) return null;
  const done = progress.value;
  const end = () =>
    store.editDocument("End the lesson", (document) => {
      const { lesson: _lesson, ...ui } = document.ui ?? {};
      return { ...document, ui };
    });
  return (
    <section class="lesson" aria-labelledby="lesson-title">
      <header>
        <h2 id="lesson-title">Your first keys</h2>
        <IconButton name="close" label="End the lesson" onClick={end} />
      </header>
      <ol>
        {STEPS.map(({ text }, i) => (
          <li key={text} data-done={i < done ? "yes" : undefined} aria-current={i === done ? "step" : undefined}>
            {i < done ? <Icon name="check" /> : <span class="lesson-number">{i + 1}</span>}
            {text}
          </li>
        ))}
      </ol>
      <p role="status">
        {done === STEPS.length ? "Well done. “Paint the film” renders it with both keys exactly." : ""}
      </p>
    </section>
  );
}

/** Steps stay done: neighbours, for example, are cleared when the next stroke begins. */
function trackProgress(store: Store): ReadonlySignal<number> {
  let most = 0;
  return computed(() => {
    const drawn = Object.entries(store.history.value.present.pictures).filter(([, picture]) =>
      picture.layers.some((layer) => layer.strokes.length),
    );
    const frames = new Set([
      ...picturesOf(store.layer.value, store.section("keys")?.part).map(({ frame }) => frame),
      ...drawn.map(([key]) => pictureAt(key).frame),
    ]);
    const painting = PAINT_TOOLS.includes(store.tool.value);
    most = Math.max(most, stepsDone({ painting, keys: frames.size, neighbours: store.neighbours.value.length }, most));
    return most;
  });
}
