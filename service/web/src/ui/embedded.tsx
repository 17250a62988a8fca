/** Elements that are built without Preact, for example a form made from a schema. */

import { useEffect, useRef } from "preact/hooks";

export interface Part {
  element: HTMLElement;
  close?(): void;
}

/** Made once, when it is mounted; give it a `key` to make it anew. */
export function Embedded({ make }: { make(): Part }) {
  const host = useRef<HTMLDivElement>(null);
  useEffect(() => {
    const part = make();
    host.current?.replaceChildren(part.element);
    return () => part.close?.();
  }, []);
  return <div ref={host} />;
}
