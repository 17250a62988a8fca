/** Looks: saved with a picture, used on one or several shots, copied from shot to shot, exported and imported. */

import { signal } from "@preact/signals";
import { useEffect, useRef, useState } from "preact/hooks";
import * as api from "../../api/api";
import { Icon, IconButton } from "../../ui/icons";
import { announce, notify } from "../../ui/notices";
import { upload } from "../../ui/upload";
import type { ProjectDocument } from "../document/document";
import * as looks from "../document/looks";
import { framesOf, titleOf } from "../document/shots";
import { createCanvas } from "../drawing/raster";
import type { Store } from "../state/store";
import { styleInputs } from "./style-library";
import { pictureOfAsset } from "./styles";

const PICTURE_PX = 320;
const COPIED = "impasto.look";

/** Of a method, the parts of a layer that belong to its look. */
function partsOf(store: Store, method: string): looks.LookParts {
  const sections = store.methods.find(({ name }) => name === method)?.studio.sections ?? [];
  const design = sections.find(({ editor }) => editor === "regions")?.part ?? "";
  return { paintings: styleInputs(store.methods), design };
}

/** The look of the selected layer with asset ids. */
function presentLook(store: Store, title: string): looks.Look {
  const layer = store.layer.peek();
  const look = looks.lookOf(title, layer, partsOf(store, layer.method), store.brush.peek());
  return looks.portable(look, store.document.peek());
}

/** Use a look on the selected layer of the shown shot, and on the uppermost layer of the others. */
async function use(store: Store, look: looks.Look, shots: readonly string[]): Promise<void> {
  const parts = partsOf(store, look.method);
  const firsts = await Promise.all(
    shots.map(async (id): Promise<[string, number]> => {
      const shot = store.document.peek().shots.find((one) => one.id === id);
      const clip = await store.session.clip(id);
      return [id, shot ? framesOf(shot, clip.info.frames ?? 1)[0] : 0];
    }),
  );
  store.editDocument(shots.length > 1 ? "Use a look on several shots" : "Use a look", (document) =>
    firsts.reduce((next, [shot, first]) => {
      const own = shot === store.shotId ? store.layer.peek().id : undefined;
      const layer = own ?? next.shots.find((one) => one.id === shot)?.layers.at(-1)?.id ?? "";
      return looks.useLook(next, { shot, layer }, look, parts, first);
    }, document),
  );
  if (look.brush) store.brush.value = look.brush;
  announce(`“${look.title}” is used on ${shots.length === 1 ? "this shot" : `${shots.length} shots`}.`);
}

/** Copy the look of the shown shot; it is kept for other projects, too. */
export function copyLook(store: Store): void {
  localStorage.setItem(COPIED, JSON.stringify(presentLook(store, titleOf(store.document.peek(), store.shotId))));
  announce("The look is copied.");
}

export async function pasteLook(store: Store): Promise<void> {
  const text = localStorage.getItem(COPIED);
  if (text) await use(store, JSON.parse(text) as looks.Look, [store.shotId]);
}

/** Another method makes the panel anew. */
const opened = signal(false);

export function Looks({ store, others }: { store: Store; others: readonly looks.Look[] }) {
  const document = store.document.value;
  const own = looks.looksOf(document);
  const applying = useRef<HTMLDialogElement>(null);
  const [chosen, setChosen] = useState<looks.Look | null>(null);
  const onShots = (look: looks.Look) => {
    setChosen(look);
    applying.current?.showModal();
  };
  return (
    <details
      class="group looks"
      open={opened.value}
      onToggle={(event) => {
        opened.value = event.currentTarget.open;
      }}
    >
      <summary>
        <span>Looks</span>
      </summary>
      {own.length + others.length > 0 && (
        <ul class="look-cards" aria-label="Looks">
          {own.map((look, i) => (
            <LookCard
              key={`${look.title}-${i}`}
              store={store}
              look={looks.portable(look, document)}
              onShots={onShots}
              onRemove={() => store.editDocument("Remove a look", (one) => without(one, i))}
            />
          ))}
          {others.map((look, i) => (
            <LookCard key={`other-${look.title}-${i}`} store={store} look={look} onShots={onShots} />
          ))}
        </ul>
      )}
      <SaveLook store={store} />
      <div class="actions">
        <button type="button" class="button small" onClick={() => copyLook(store)}>
          Copy the look
        </button>
        <button type="button" class="button small" onClick={() => pasteLook(store).catch(notify)}>
          Paste the look
        </button>
        <label class="button small file-button">
          Import a look
          <input
            type="file"
            accept=".json,application/json"
            aria-label="Import a look"
            onChange={({ currentTarget: input }) => {
              const file = input.files?.[0];
              if (file) importLook(store, file).catch(notify);
              input.value = "";
            }}
          />
        </label>
      </div>
      <dialog ref={applying} class="project-menu" aria-labelledby="apply-title">
        {chosen && <OnShots store={store} look={chosen} close={() => applying.current?.close()} />}
      </dialog>
    </details>
  );
}

const without = (document: ProjectDocument, index: number): ProjectDocument =>
  looks.withLooks(
    document,
    looks.looksOf(document).filter((_, i) => i !== index),
  );

interface LookCardProps {
  store: Store;
  look: looks.Look;
  onShots(look: looks.Look): void;
  onRemove?: () => void;
}

function LookCard({ store, look, onShots, onRemove }: LookCardProps) {
  const several = store.document.value.shots.length > 1;
  const method = store.methods.find(({ name }) => name === look.method)?.title ?? look.method;
  return (
    <li class="look-card">
      <button
        type="button"
        class="style-card"
        title={`Use this look: ${method}`}
        onClick={() => use(store, look, [store.shotId]).catch(notify)}
      >
        <Picture asset={look.picture ?? ""} />
        <span>{look.title}</span>
      </button>
      {several && <IconButton name="film" label={`Use ${look.title} on several shots`} onClick={() => onShots(look)} />}
      <IconButton name="download" label={`Export ${look.title}`} onClick={() => exportLook(look).catch(notify)} />
      {onRemove && <IconButton name="trash" label={`Remove ${look.title}`} onClick={onRemove} />}
    </li>
  );
}

function Picture({ asset }: { asset: string }) {
  const [src, setSrc] = useState("");
  useEffect(() => {
    let current = true;
    if (asset)
      pictureOfAsset(asset).then(
        (url) => (current ? setSrc(url) : URL.revokeObjectURL(url)),
        () => {},
      );
    return () => {
      current = false;
    };
  }, [asset]);
  useEffect(() => () => URL.revokeObjectURL(src), [src]);
  return src ? <img src={src} alt="" /> : <span class="card-blank" />;
}

function OnShots({ store, look, close }: { store: Store; look: looks.Look; close(): void }) {
  const document = store.document.value;
  const apply = (event: Event) => {
    event.preventDefault();
    const form = new FormData(event.currentTarget as HTMLFormElement);
    const shots = form.getAll("shot").map(String);
    close();
    if (shots.length) use(store, look, shots).catch(notify);
  };
  return (
    <form onSubmit={apply}>
      <h2 id="apply-title">Use “{look.title}” on shots</h2>
      {document.shots.map(({ id }) => (
        <label key={id} class="check-row">
          <input type="checkbox" name="shot" value={id} defaultChecked />
          {titleOf(document, id)}
        </label>
      ))}
      <div class="actions">
        <button type="submit" class="button primary">
          Use it
        </button>
        <button type="button" class="button" onClick={close}>
          Cancel
        </button>
      </div>
    </form>
  );
}

/** Keep the look under a name, with a picture of the shown frame. */
function SaveLook({ store }: { store: Store }) {
  const [title, setTitle] = useState("");
  const save = async (event: Event) => {
    event.preventDefault();
    const look = presentLook(store, title.trim());
    setTitle("");
    const picture = await pictureOf(store);
    store.editDocument("Save a look", (document) => {
      const [next, named] = looks.adopted(document, picture ? { ...look, picture } : look);
      return looks.withLooks(next, [...looks.looksOf(next), named]);
    });
  };
  return (
    <form class="save-style" onSubmit={(event) => save(event).catch(notify)}>
      <input
        type="text"
        maxLength={80}
        required
        value={title}
        placeholder="Name of this look"
        aria-label="Name of the look to save"
        onInput={(event) => setTitle(event.currentTarget.value)}
      />
      <button type="submit" class="button small" disabled={!title.trim()}>
        <Icon name="plus" />
        Save look
      </button>
    </form>
  );
}

/** The shown frame as it is painted now, small, as an asset; its id, or empty if it is not painted yet. */
async function pictureOf(store: Store): Promise<string> {
  const shown = store.results.peek().get(store.frame.peek());
  if (!shown) return "";
  const scale = Math.min(1, PICTURE_PX / Math.max(shown.picture.width, shown.picture.height));
  const size = {
    width: Math.max(1, Math.round(scale * shown.picture.width)),
    height: Math.max(1, Math.round(scale * shown.picture.height)),
  };
  const [canvas, context] = createCanvas(size);
  context.imageSmoothingQuality = "high";
  context.drawImage(shown.picture, 0, 0, size.width, size.height);
  const blob = await new Promise<Blob | null>((done) => canvas.toBlob(done, "image/png"));
  return blob ? (await upload(new File([blob], "look.png", { type: "image/png" }))).id : "";
}

async function exportLook(look: looks.Look): Promise<void> {
  const read = async (id: string): Promise<[string, { name: string; data: string }]> => {
    const [about, answer] = await Promise.all([api.asset(id), api.request(api.paths.content(id))]);
    return [id, { name: about.filename, data: await dataUrl(await answer.blob()) }];
  };
  const files = Object.fromEntries(await Promise.all(looks.assetsOf(look).map(read)));
  const text = JSON.stringify(looks.fileOf(look, files), null, 1);
  api.saveFile(new Blob([text], { type: "application/json" }), `${look.title}.look.json`);
}

const dataUrl = (blob: Blob): Promise<string> =>
  new Promise((resolve, reject) => {
    const reader = new FileReader();
    reader.onload = () => resolve(String(reader.result));
    reader.onerror = () => reject(reader.error);
    reader.readAsDataURL(blob);
  });

async function importLook(store: Store, file: File): Promise<void> {
  const found = await file
    .text()
    .then(looks.readLook)
    .catch(() => {
      throw new api.Problem({ detail: `“${file.name}” is no look.`, remedy: "Choose a file that Export made." });
    });
  if (!store.methods.some(({ name }) => name === found.look.method))
    throw new api.Problem({
      detail: `The look needs the method ${found.look.method}, which this service does not have.`,
      remedy: "Install it, or choose another look.",
    });
  const ids = new Map<string, string>();
  for (const [id, { name, data }] of Object.entries(found.files)) ids.set(id, (await upload(fileOf(name, data))).id);
  const look = looks.renumbered(found.look, ids);
  store.editDocument("Import a look", (document) => {
    const [next, named] = looks.adopted(document, look);
    return looks.withLooks(next, [...looks.looksOf(next), named]);
  });
}

/** The page's policy allows no requests of data: addresses. */
function fileOf(name: string, data: string): File {
  const [, base64 = ""] = data.split(",");
  return new File([Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0))], name);
}
