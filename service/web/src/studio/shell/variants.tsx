/** Variants: settings kept under a name, shown on the present frame, compared in the wipe, rendered together. */

import { useEffect, useState } from "preact/hooks";
import * as api from "../../api/api";
import { Icon, IconButton } from "../../ui/icons";
import { notify } from "../../ui/notices";
import { checkProject, pictureOf, preview, submitProject } from "../document/api";
import { freeName, type Variant } from "../document/document";
import { cardsOf, completedSet, paramsOf } from "../document/variant-patch";
import type { Store } from "../state/store";

const CARD_PX = 240;
const WIPE_PX = 960;
/** Means the present state of the layer. */
const PRESENT = "present";

export function Variants({ store, saveAll }: { store: Store; saveAll(): Promise<boolean> }) {
  const { id: layer, method } = store.layer.value;
  const variants = (store.document.value.variants ?? []).filter(
    (variant) => variant.layer === layer && (variant.set.method ?? method) === method,
  );
  const [sides, setSides] = useState<[string, string]>([PRESENT, ""]);
  const [comparing, setComparing] = useState(false);
  const pictures = useCards(store, variants, CARD_PX);
  const right = sides[1] || (variants.at(-1)?.id ?? "");
  const left = sides[0] === PRESENT || variants.some(({ id }) => id === sides[0]) ? sides[0] : PRESENT;
  useComparison(store, comparing && variants.length > 0 ? [left, right] : null, variants);

  const keep = () =>
    store.editDocument("Keep a variant", (document) => {
      const all = document.variants ?? [];
      const id = freeName("v1", (candidate) => all.some((variant) => variant.id === candidate));
      const { shot } = store.place;
      const set = { method, params: store.layer.value.params ?? {} };
      const name = `Variant ${all.length + 1}`;
      return { ...document, variants: [...all, { id, name, shot, layer, set, frame: store.frame.value }] };
    });
  const drop = (id: string) =>
    store.editDocument("Remove a variant", (document) => ({
      ...document,
      variants: (document.variants ?? []).filter((variant) => variant.id !== id),
    }));
  const use = (variant: Variant) =>
    store.editLayer(`Use ${variant.name}`, (one) => ({ ...one, params: paramsOf(variant) }));
  return (
    <section class="side-section" aria-labelledby="variants-title">
      <h2 id="variants-title">Variants</h2>
      {!variants.length && <p class="hint">Keep these settings, change some, and compare the two on this frame.</p>}
      <div class="library-cards" role="group" aria-label="Variants">
        {variants.map((variant) => (
          <div key={variant.id} class="variant-card">
            <button type="button" class="style-card" onClick={() => use(variant)} title="Use these settings">
              {pictures.has(variant.id) ? <img src={pictures.get(variant.id)} alt="" /> : <span class="card-blank" />}
              <span>{variant.name}</span>
            </button>
            <IconButton name="trash" label={`Remove ${variant.name}`} onClick={() => drop(variant.id)} />
          </div>
        ))}
      </div>
      <div class="actions">
        <button type="button" class="button small" onClick={keep}>
          <Icon name="plus" />
          Keep these settings
        </button>
        {variants.length > 1 && <RenderAll store={store} variants={variants} saveAll={saveAll} />}
      </div>
      {variants.length > 0 && store.previews.value && (
        <div class="compare-variants">
          <button type="button" class="button small" aria-pressed={comparing} onClick={() => setComparing(!comparing)}>
            {comparing ? "End the comparison" : "Compare on this frame"}
          </button>
          {comparing && (
            <>
              <SideChoice
                label="Left of the divider"
                value={left}
                variants={variants}
                onChange={(id) => setSides([id, right])}
              />
              <SideChoice
                label="Right of the divider"
                value={right}
                variants={variants}
                onChange={(id) => setSides([left, id])}
              />
            </>
          )}
        </div>
      )}
    </section>
  );
}

interface SideChoiceProps {
  label: string;
  value: string;
  variants: readonly Variant[];
  onChange(id: string): void;
}

function SideChoice({ label, value, variants, onChange }: SideChoiceProps) {
  return (
    <label class="inline-field">
      {label}
      <select value={value} onChange={(event) => onChange(event.currentTarget.value)}>
        <option value={PRESENT}>Present settings</option>
        {variants.map(({ id, name }) => (
          <option key={id} value={id}>
            {name}
          </option>
        ))}
      </select>
    </label>
  );
}

/** A job for each variant, then the page that compares their films. */
function RenderAll({ store, variants, saveAll }: { store: Store; variants: Variant[]; saveAll(): Promise<boolean> }) {
  const [sending, setSending] = useState(false);
  const send = async () => {
    setSending(true);
    try {
      const layer = store.layer.value;
      store.editDocument("Complete the variants", (document) => ({
        ...document,
        variants: (document.variants ?? []).map((variant) =>
          variants.includes(variant) ? { ...variant, set: completedSet(variant, layer) } : variant,
        ),
      }));
      if (!(await saveAll())) throw new api.Problem({ detail: "The project is not saved." });
      const [fault] = await checkProject(store.projectId);
      if (fault) throw new api.Problem({ detail: fault.message, remedy: fault.remedy });
      const made = await submitProject(store.projectId, { variants: variants.map(({ id }) => id) }, api.token());
      location.hash = `#/compare/${made.map(({ job }) => job.id).join(",")}`;
    } catch (error) {
      notify(error);
    }
    setSending(false);
  };
  return (
    <button type="button" class="button small" disabled={sending} onClick={send}>
      Paint all {variants.length} variants
    </button>
  );
}

/** The present frame with each variant, as object URLs by the variant's id. */
function useCards(store: Store, variants: readonly Variant[], side: number): ReadonlyMap<string, string> {
  const [pictures, setPictures] = useState<ReadonlyMap<string, string>>(new Map());
  const frame = store.frame.value;
  const wanted = JSON.stringify([variants.map(({ set }) => set), store.layer.value.id, frame]);
  useEffect(() => {
    if (!variants.length || !store.previews.value) return;
    const controller = new AbortController();
    const urls: string[] = [];
    const show = (card: string, blob: Blob) => {
      const url = URL.createObjectURL(blob);
      urls.push(url);
      setPictures((known) => new Map(known).set(card, url));
    };
    const timer = setTimeout(() => {
      paintCards(
        store,
        cardsOf(variants, store.layer.peek()),
        side,
        "variants",
        controller.signal,
        ({ header, payload }) => {
          if (header.type === "frame" && header.card)
            show(header.card, new Blob([payload], { type: header.media_type }));
        },
      );
    }, 400);
    return () => {
      clearTimeout(timer);
      controller.abort();
      for (const url of urls) URL.revokeObjectURL(url);
      setPictures(new Map());
    };
  }, [wanted, store.previews.value]);
  return pictures;
}

/** Show two variants of the present frame on the stage while `sides` names them. */
function useComparison(store: Store, sides: [string, string] | null, variants: readonly Variant[]): void {
  const wanted = JSON.stringify([sides, variants.map(({ set }) => set), store.layer.value.params, store.frame.value]);
  useEffect(() => {
    if (!sides) return;
    const controller = new AbortController();
    const found = new Map<string, ImageBitmap>();
    const all = [{ id: PRESENT, set: {} }, ...cardsOf(variants, store.layer.peek())];
    const cards = all.filter(({ id }) => sides.includes(id));
    paintCards(store, cards, WIPE_PX, "compare", controller.signal, async (record) => {
      if (record.header.type !== "frame" || !record.header.card) return;
      found.set(record.header.card, await pictureOf(record));
      const [left, right] = sides.map((id) => found.get(id));
      if (left && right && !controller.signal.aborted) store.compared.value = { left, right };
    });
    return () => {
      controller.abort();
      store.compared.value = null;
    };
  }, [wanted]);
}

function paintCards(
  store: Store,
  cards: object[],
  side: number,
  channel: string,
  signal: AbortSignal,
  onrecord: Parameters<typeof preview>[0]["onrecord"],
): void {
  const place = { document: store.document.peek(), shot: store.shot.peek().id, layer: store.layer.peek().id };
  const body = { ...place, frame: store.frame.peek(), cards, max_side_px: side };
  preview({ project: store.projectId, what: "styles", channel, body, signal, onrecord }).catch(
    (error) => api.isAbort(error) || console.info("Impasto: no pictures of variants.", error),
  );
}
