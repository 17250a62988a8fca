/** A colour scheme that a running session follows: stored as a file whenever the pen rests. */

import { useEffect, useRef, useState } from "preact/hooks";
import { get, paths } from "../api/api";
import type { Section } from "../api/schemas";
import type { ColourScheme } from "../forms/colour-scheme";
import { SchemeEditor } from "../forms/scheme-editor";
import { notify } from "../ui/notices";
import { upload } from "../ui/upload";

const REST_MS = 250;

export interface SchemeInputProps {
  section: Section;
  /** Of the stored scheme; empty: none. */
  id: string;
  source: ColourScheme | null;
  /** What the service says against it. */
  fault: string;
  onChange(id: string): void;
}

export function SchemeInput({ section, id, source, fault, onChange }: SchemeInputProps) {
  const [scheme, setScheme] = useState<ColourScheme | null>(null);
  const stored = useRef("");
  const latest = useRef<ColourScheme | null>(null);
  const timer = useRef(0);
  useEffect(() => {
    if (id && id !== stored.current) get<ColourScheme>(paths.content(id)).then(setScheme, () => onChange(""));
    stored.current = id;
  }, [id]);
  useEffect(() => () => clearTimeout(timer.current), []);
  const store = async (given: ColourScheme) => {
    const { id: made } = await upload(new File([JSON.stringify(given)], "colour-scheme.json"));
    if (latest.current !== given) return;
    stored.current = made;
    onChange(made);
  };
  const change = (given: ColourScheme | null) => {
    latest.current = given;
    setScheme(given);
    clearTimeout(timer.current);
    if (given) timer.current = window.setTimeout(() => store(given).catch(notify), REST_MS);
    else onChange("");
  };
  return (
    <details class="group scheme-input" open={Boolean(id || fault)}>
      <summary>
        <span>{section.title}</span>
      </summary>
      <div class="group-body">
        <p class="field-help">{section.hint}</p>
        <SchemeEditor scheme={scheme} source={source} onChange={change} />
        <p class="field-error">{fault}</p>
      </div>
    </details>
  );
}
