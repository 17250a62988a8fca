/** Controls for a colour, and for a list of colours: a palette, whose colours may be taken from a picture. */

import { useId } from "preact/hooks";
import { Icon, IconButton } from "../ui/icons";
import { notify } from "../ui/notices";
import { mainColours, pixelsOf } from "../ui/palette";
import { type Control, described } from "./control";

/** How many colours are taken from a picture. */
const TAKEN = 6;
const NEW = "#808080";

export const ColourBox: Control = (props) => (
  <input
    type="color"
    class="colour-box"
    id={props.ids.input}
    value={String(props.value)}
    onInput={(event) => props.onChange(event.currentTarget.value)}
    {...described(props)}
  />
);

export const ColourList: Control = (props) => {
  const { field, ids, value, onChange } = props;
  const colours: readonly string[] = Array.isArray(value) ? value.map(String) : [];
  const most = field.most ?? Number.POSITIVE_INFINITY;
  const picture = useId();
  const take = (file: File | undefined) => {
    if (file) pixelsOf(file).then((pixels) => onChange(mainColours(pixels, Math.min(TAKEN, most))), notify);
  };
  return (
    <>
      {colours.length > 0 && (
        <ul class="colour-list" aria-labelledby={ids.label}>
          {colours.map((colour, index) => (
            <li key={index}>
              <input
                type="color"
                class="colour-box"
                aria-label={`${field.title}: colour ${index + 1}`}
                value={colour}
                onInput={({ currentTarget }) => onChange(colours.with(index, currentTarget.value))}
              />
              <IconButton
                name="close"
                label={`Remove colour ${index + 1}`}
                onClick={() => onChange(colours.toSpliced(index, 1))}
              />
            </li>
          ))}
        </ul>
      )}
      <div class="actions">
        <button
          type="button"
          class="button small"
          disabled={colours.length >= most}
          onClick={() => onChange([...colours, colours.at(-1) ?? NEW])}
          {...described(props)}
        >
          <Icon name="plus" />
          Add a colour
        </button>
        <label class="button small file-button" for={picture}>
          <Icon name="image" />
          From a picture
          <input
            type="file"
            id={picture}
            accept="image/*"
            onChange={({ currentTarget }) => {
              take(currentTarget.files?.[0]);
              currentTarget.value = "";
            }}
          />
        </label>
      </div>
    </>
  );
};
