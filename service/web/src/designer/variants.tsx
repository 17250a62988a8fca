/** Variants: settings kept under a name, to go back to or to render beside each other. */

import type { Json, Params } from "../shared/types";
import { freeName, type Variant } from "./document";
import { Icon, IconButton } from "./icon";
import type { Store } from "./store";

/** Parameters of a merge patch; null stands for a parameter that is left at its default. */
const withoutNull = (patch: Record<string, Json>): Params =>
  Object.fromEntries(Object.entries(patch).filter(([, value]) => value !== null));

export function Variants({ store }: { store: Store }) {
  const variants = (store.document.value.variants ?? []).filter((variant) => variant.layer === store.layer.value.id);
  const keep = () => {
    const { shot, layer } = store.place;
    const params = store.layer.value.params ?? {};
    store.editDocument("Keep a variant", (document) => {
      const all = document.variants ?? [];
      const id = freeName("v1", (candidate) => all.some((variant) => variant.id === candidate));
      const variant: Variant = {
        id,
        name: `Variant ${all.length + 1}`,
        shot,
        layer,
        set: { params },
        frame: store.frame.value,
      };
      return { ...document, variants: [...all, variant] };
    });
  };
  const use = (variant: Variant) =>
    store.editLayer(`Use ${variant.name}`, (layer) => ({ ...layer, params: withoutNull(variant.set.params ?? {}) }));
  const drop = (id: string) =>
    store.editDocument("Remove a variant", (document) => ({
      ...document,
      variants: (document.variants ?? []).filter((variant) => variant.id !== id),
    }));
  return (
    <section class="side-section" aria-labelledby="variants-title">
      <h2 id="variants-title">Variants</h2>
      <ul class="region-list">
        {variants.map((variant) => (
          <li key={variant.id}>
            <button type="button" class="layer-name" onClick={() => use(variant)}>
              {variant.name}: {Object.keys(variant.set.params ?? {}).length} settings
            </button>
            <IconButton name="trash" label={`Remove ${variant.name}`} onClick={() => drop(variant.id)} />
          </li>
        ))}
      </ul>
      <button type="button" class="button small" onClick={keep}>
        <Icon name="plus" />
        Keep these settings
      </button>
    </section>
  );
}
