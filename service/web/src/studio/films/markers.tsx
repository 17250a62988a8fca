/** Markers: frames of a shot with a note, which stay in the project. */

import { Icon, IconButton } from "../../ui/icons";
import { changeShot, putAtFrame, removeAtFrame, type Shot } from "../document/document";
import type { Store } from "../state/store";
import { isShown, shareOf } from "../state/timeline";

export interface Marker {
  frame: number;
  note: string;
}

export const markersOf = ({ ui }: Shot): readonly Marker[] =>
  Array.isArray(ui?.markers) ? (ui.markers as unknown as Marker[]) : [];

function edit(store: Store, label: string, change: (markers: readonly Marker[]) => Marker[]): void {
  store.editDocument(label, (document) =>
    changeShot(document, store.shotId, (shot) => ({
      ...shot,
      ui: { ...shot.ui, markers: change(markersOf(shot)) as never },
    })),
  );
}

/** A marker at the shown frame, or none if there is one. */
export function toggleMarker(store: Store): void {
  const frame = store.frame.peek();
  const known = markersOf(store.shot.peek()).some((marker) => marker.frame === frame);
  if (known) edit(store, "Remove a marker", (markers) => removeAtFrame(markers, frame));
  else edit(store, "Set a marker", (markers) => putAtFrame(markers, { frame, note: "" }));
}

/** The markers below the filmstrip, and the note of the one at the shown frame. */
export function Markers({ store }: { store: Store }) {
  const markers = markersOf(store.shot.value);
  const span = store.span.value;
  const present = markers.find(({ frame }) => frame === store.frame.value);
  if (!markers.length) return null;
  return (
    <div class="markers" role="group" aria-label="Markers">
      <div class="marker-lane">
        {markers
          .filter(({ frame }) => isShown(frame, span))
          .map(({ frame, note }) => {
            const label = `Marker at frame ${frame + 1}${note ? `: ${note}` : ""}`;
            return (
              <button
                key={frame}
                type="button"
                class="marker"
                aria-label={label}
                title={label}
                aria-current={frame === store.frame.value ? "true" : undefined}
                style={{ left: `${100 * shareOf(frame + 0.5, span)}%` }}
                onClick={() => store.goTo(frame)}
              >
                <Icon name="flag" />
              </button>
            );
          })}
      </div>
      {present && <Note key={present.frame} store={store} marker={present} />}
    </div>
  );
}

function Note({ store, marker }: { store: Store; marker: Marker }) {
  return (
    <div class="marker-note">
      <input
        type="text"
        maxLength={500}
        value={marker.note}
        placeholder="Note"
        aria-label={`Note at frame ${marker.frame + 1}`}
        onChange={({ currentTarget: { value } }) =>
          edit(store, "Change a note", (markers) => putAtFrame(markers, { ...marker, note: value }))
        }
      />
      <IconButton name="trash" label="Remove the marker" onClick={() => toggleMarker(store)} />
    </div>
  );
}
