/** The style of the selected region at the shown frame: its card, its numbers, and how it changes to the next key. */

import type { Schemas, Section } from "../../api/schemas";
import { Icon, IconButton } from "../../ui/icons";
import {
  type Design,
  type Ease,
  putOnTrack,
  REST,
  removeFromTrack,
  type StyleKey,
  trackOf,
  withRegion,
} from "../document/design";
import { keyAt } from "../document/document";
import type { Store } from "../state/store";
import { StyleCards } from "../styles/style-cards";
import type { RegionsProps } from "./regions-section";
import { shownParameter } from "./style-lane";
import { keyHere, type StyleContext, styleAt, withoutUnusedMixes } from "./style-values";

export const EASES: [Ease, string][] = [
  ["linear", "Steadily"],
  ["smooth", "Smoothly"],
  ["in", "Slowly at first"],
  ["out", "Slowly at the end"],
  ["hold", "At once, at the next key"],
];

/** What the styles of the selected layer are made from. */
export const styleContext = (store: Store, section: Section): StyleContext => ({
  section,
  design: store.design,
  params: { ...store.method.value?.defaults, ...store.layer.value.params },
});

/** Change the key of a region at a frame; a key that there was not has the values of this time. */
export function editStyleKey(
  store: Store,
  { section, region, frame }: { section: Section; region: string; frame: number },
  label: string,
  change: (key: StyleKey) => Partial<StyleKey>,
  group = "",
): void {
  store.editDesign(
    label,
    (design) => {
      const context = { ...styleContext(store, section), design };
      const { key, styles } = keyHere(context, region, frame) ?? { key: { region, frame }, styles: design.styles };
      const keys = putOnTrack(design.keys, { ...key, ...change(key) });
      return withBorder(withoutUnusedMixes({ ...design, ...(styles && { styles }), keys }), region);
    },
    group,
  );
}

export function StyleKeys({ store, section }: RegionsProps) {
  const region = store.region.value || REST;
  const frame = store.frame.value;
  const place = { section, region, frame };
  const track = trackOf(store.design.keys, region);
  const key = keyAt(track, frame);
  const style = styleAt(styleContext(store, section), region, frame);
  const exact = key?.frame === frame;
  const own = section.styles.every(({ value }) => value !== key?.style) && key?.style;
  /** The style with the numbers that the key changes, as they are at this time. */
  const choose = (name: string) =>
    editStyleKey(store, place, "Choose a style", () => ({
      style: name,
      ...(key && { set: Object.fromEntries(Object.keys(key.set ?? {}).map((one) => [one, style?.values[one]])) }),
    }));
  const setEase = (ease: Ease) =>
    editStyleKey(store, { ...place, frame: key?.frame ?? frame }, "Change the easing", () => ({ ease }));
  const drop = () =>
    store.editDesign("Remove a style key", (design) =>
      withoutUnusedMixes({ ...design, keys: removeFromTrack(design.keys, region, frame) }),
    );
  const sliders = (basic: boolean) =>
    section.sliders
      .filter((slider) => slider.basic === basic)
      .map((slider) => (
        <StyleSlider
          key={slider.name}
          slider={slider}
          value={style?.values[slider.name] ?? slider.minimum}
          set={key?.set?.[slider.name] !== undefined}
          onChange={(value) => {
            shownParameter.value = slider.name;
            const label = `Change ${slider.title.toLowerCase()}`;
            const change = (known: StyleKey) => ({ set: changed(known, slider.name, value) });
            editStyleKey(store, place, label, change, `style-${slider.name}`);
          }}
        />
      ));
  const hidden = section.sliders.filter(({ basic, name }) => !basic && key?.set?.[name] !== undefined).length;
  return (
    <section class="side-section" aria-labelledby="styles-title">
      <h2 id="styles-title">Style of {region === REST ? "everything else" : region}</h2>
      <StyleCards store={store} section={section} chosen={key?.style ?? ""} onChoose={choose} />
      {own && <p class="hint">This key has a style of its own: {own}.</p>}
      {key && (
        <>
          {sliders(true)}
          <details class="more-settings">
            <summary>All settings of the style{hidden > 0 && <small> ({hidden} changed)</small>}</summary>
            {sliders(false)}
          </details>
          <label class="inline-field">
            Change to the next key
            <select value={key.ease ?? "linear"} onChange={(event) => setEase(event.currentTarget.value as Ease)}>
              {EASES.map(([ease, title]) => (
                <option key={ease} value={ease}>
                  {title}
                </option>
              ))}
            </select>
          </label>
        </>
      )}
      <p class="hint">
        {track.length
          ? `${track.length > 1 ? "Keys at frames" : "Key at frame"} ${track.map((one) => one.frame + 1).join(", ")}. `
          : ""}
        {key && !exact ? "A change here makes a key at this frame, with the values of this time." : ""}
        {!key && store.design.keys?.length ? "Without a style of its own, it takes those of the others." : ""}
      </p>
      {exact && (
        <button type="button" class="button small" onClick={drop}>
          <Icon name="trash" />
          Remove the key at this frame
        </button>
      )}
    </section>
  );
}

/** The design with a border round the region across which its style does not spread, unless it has a border already: the
 * style is for this region only. */
function withBorder(design: Design, name: string): Design {
  const region = design.regions?.[name];
  return region && !region.border ? withRegion(design, name, { ...region, border: "sharp" }) : design;
}

function changed(key: StyleKey, name: string, value: number | undefined): StyleKey["set"] {
  const { [name]: _old, ...rest } = key.set ?? {};
  return value === undefined ? rest : { ...rest, [name]: value };
}

interface StyleSliderProps {
  slider: Schemas["Slider"];
  value: number;
  /** Whether the key changes it; else it is the style's own. */
  set: boolean;
  onChange(value: number | undefined): void;
}

function StyleSlider({ slider, value, set, onChange }: StyleSliderProps) {
  const { title, minimum, maximum, step, about } = slider;
  return (
    <label class="style-slider" title={about}>
      <span>{title}</span>
      <input
        type="range"
        min={minimum}
        max={maximum}
        step={step}
        value={value}
        class={set ? "" : "unset"}
        aria-label={title}
        onInput={(event) => onChange(Number(event.currentTarget.value))}
      />
      <output>{Math.round(100 * value) / 100}</output>
      {set && <IconButton name="retry" label={`Reset ${title}`} onClick={() => onChange(undefined)} />}
    </label>
  );
}
