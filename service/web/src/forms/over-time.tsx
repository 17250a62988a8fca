/** A number that varies over the film: its slider at the present frame, its curve, and its keys. */

import type { ReadonlySignal } from "@preact/signals";
import { Icon } from "../ui/icons";
import { type Key, ValueCurve } from "../ui/value-curve";
import type { Control, ControlProps } from "./control";
import { keysOf, valueAt, withKey, withoutKey } from "./keyed-values";
import { snap } from "./schema";

/** Where a form's keys are set. */
export interface FilmTime {
  /** The present frame, a number of the film. */
  frame: ReadonlySignal<number>;
  /** Frames [first, end) of the shot. */
  span: ReadonlySignal<readonly [number, number]>;
}

/** Turns a number into one with values over time, and back: as it is at the present frame. */
export function OverTimeButton({ field, value, time, onChange }: ControlProps & { time: FilmTime }) {
  const keys = keysOf(value);
  const turn = () => {
    const frame = time.frame.peek();
    onChange(keys ? snap(valueAt(keys, frame), field) : [[frame, value]]);
  };
  return (
    <button
      type="button"
      class="over-time-button"
      aria-label={`${field.title} over time`}
      aria-pressed={Boolean(keys)}
      title={keys ? "Back to one value for the whole film" : "Values over time: a key at this frame"}
      onClick={turn}
    >
      <Icon name="key" />
    </button>
  );
}

interface OverTimeProps extends ControlProps {
  keys: readonly Key[];
  time: FilmTime;
  /** Sets the value at one frame. */
  Slider: Control;
}

export function OverTime({ keys, time, Slider, ...props }: OverTimeProps) {
  const { field, onChange } = props;
  const frame = time.frame.value;
  const exact = keys.some(([at]) => at === frame);
  const now = valueAt(keys, frame);
  const set = (at: number, value: number) => onChange(withKey(keys, at, value));
  return (
    <div class="over-time">
      <Slider {...props} value={now} onChange={(value) => set(frame, Number(value))} />
      <div class="value-curve">
        <ValueCurve
          span={time.span.value}
          frame={frame}
          keys={keys}
          value={(at) => valueAt(keys, at)}
          minimum={field.min ?? 0}
          maximum={field.max ?? 1}
          step={field.step === "any" ? 0.01 : field.step}
          title={field.title}
          onSet={set}
        />
      </div>
      <p class="field-help">
        <button
          type="button"
          class="button small"
          onClick={() => onChange(exact ? withoutKey(keys, frame) : withKey(keys, frame, now))}
        >
          {exact ? "Remove the key at this frame" : "Add a key at this frame"}
        </button>
        <span>{`${keys.length > 1 ? "Keys at frames" : "Key at frame"} ${keys.map(([at]) => at + 1).join(", ")}.`}</span>
      </p>
    </div>
  );
}
