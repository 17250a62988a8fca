/** Choosing a method by card and a ready set of parameters by chip. */

import { useId } from "preact/hooks";
import type { Example, Method, Params } from "../api/schemas";
import { useMediaUrl } from "../ui/media";

export interface MethodCardsProps {
  methods: readonly Method[];
  chosen: string;
  onChoose(name: string): void;
}

export function MethodCards({ methods, chosen, onChoose }: MethodCardsProps) {
  const name = useId();
  return (
    <div class="cards" role="radiogroup" aria-label="Method">
      {methods.map((method) => (
        <label key={method.name} class="card">
          <input
            type="radio"
            name={name}
            value={method.name}
            checked={method.name === chosen}
            onChange={() => onChoose(method.name)}
          />
          <Picture path={method.thumbnail} />
          <span class="card-text">
            <strong>{method.title}</strong>
            <span>{method.summary}</span>
          </span>
        </label>
      ))}
    </div>
  );
}

/** The picture that the service offers of a method. */
function Picture({ path }: { path: string }) {
  const url = useMediaUrl(path);
  return path ? <img class="card-picture" alt="" {...(url && { src: url })} /> : null;
}

/** One transparent pixel: an image without an address takes no room. */
const NOTHING = "data:image/svg+xml,%3Csvg xmlns='http://www.w3.org/2000/svg'/%3E";

/** The examples of a method, the defaults first. */
export const presetsOf = (examples: Example[]): Example[] => [
  { name: "default", title: "Default", params: {} },
  ...examples.filter((example) => Object.keys(example.params).length),
];

export interface PresetsProps {
  examples: Example[];
  /** The present parameters: the example that has them is marked. */
  params: Params;
  onChoose(params: Params): void;
  /** Object URLs by name of the example, where there will be pictures. */
  pictures?: ReadonlyMap<string, string> | null;
  /** Width to height of the pictures. */
  ratio?: number;
}

/** Chips of a method's examples. */
export function Presets({ examples, params, onChoose, pictures = null, ratio = 1 }: PresetsProps) {
  const key = (values: Params) => JSON.stringify(Object.entries(values).sort());
  return (
    <div
      class={`presets ${pictures ? "pictured" : ""}`}
      role="group"
      aria-label="Presets"
      style={pictures ? { "--ratio": ratio } : {}}
    >
      {presetsOf(examples).map((example) => (
        <button
          key={example.name}
          type="button"
          class="chip-button"
          aria-pressed={key(example.params) === key(params)}
          onClick={() => onChoose(example.params)}
        >
          <img class="card-blank" alt="" src={pictures?.get(example.name) ?? NOTHING} />
          <span>{example.title}</span>
        </button>
      ))}
    </div>
  );
}
