/** What every page does at its start. */

import { type ComponentChildren, render } from "preact";
import { useErrorBoundary } from "preact/hooks";
import { asProblem, onKeyNeeded } from "../api/api";
import { askKey } from "./dialogs";
import { byId } from "./dom";
import { ProblemBlock } from "./notices";

/** Prepare the key dialog, the skip link and dropped files; returns what shows another content, made anew. */
export function preparePage(): (content: ComponentChildren) => void {
  const main = byId("main");
  let shown = 0;
  onKeyNeeded(askKey);
  byId("skip").addEventListener("click", () => main.focus());
  for (const kind of ["dragover", "drop"]) window.addEventListener(kind, (event) => event.preventDefault());
  return (content) => render(<Guarded key={++shown}>{content}</Guarded>, main);
}

/** A fault of the page itself is shown; without this the page would be empty. */
function Guarded({ children }: { children: ComponentChildren }) {
  const [error] = useErrorBoundary();
  if (!error) return children;
  return (
    <div class="failure">
      <ProblemBlock error={asProblem(error)}>
        <button type="button" class="button primary" onClick={() => location.reload()}>
          Load the page again
        </button>
      </ProblemBlock>
    </div>
  );
}
