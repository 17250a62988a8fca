/** A slider with its name and value. */

export interface SliderProps {
  label: string;
  /** For assistive technology, if the label alone is not clear. */
  name?: string;
  min: number;
  max: number;
  step?: number;
  value: number;
  text: string;
  onChange(value: number): void;
}

export function Slider({ label, name, min, max, step = 1, value, text, onChange }: SliderProps) {
  return (
    <label>
      <span class="slider-label">{label}</span>
      <input
        type="range"
        min={min}
        max={max}
        step={step}
        value={value}
        aria-label={name ?? label}
        onInput={(event) => onChange(Number(event.currentTarget.value))}
      />
      <output>{text}</output>
    </label>
  );
}
