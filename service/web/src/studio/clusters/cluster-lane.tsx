/** The lane under the filmstrip: how uncertain the clusters of each frame are, and which frames are solved again. */

import type { Store } from "../state/store";
import { isShown, shareOf } from "../state/timeline";
import { type Clusters, worst } from "./clusters";

export function ClusterLane({ store, clusters }: { store: Store; clusters: Clusters }) {
  if (!store.overlay("labels") || !clusters.available.value) return null;
  const { frames } = store;
  const span = store.span.value;
  const uncertainty = clusters.uncertainty.value;
  const here = worst(uncertainty.get(store.frame.value));
  const bars = [...uncertainty].map(([frame, labels]) => {
    const value = worst(labels);
    return `M${frame} 100h1v${-Math.round(100 * value)}h-1z`;
  });
  return (
    <div class="cluster-lane">
      <svg
        viewBox={`${span[0]} 0 ${span[1] - span[0]} 100`}
        preserveAspectRatio="none"
        role="img"
        aria-label={`Uncertainty of the clusters: ${Math.round(100 * here)} % in frame ${store.frame.value + 1}`}
      >
        {clusters.corrections.map(({ frame, solve }) => (
          <rect
            key={frame}
            class="solved"
            x={solve?.[0] ?? 0}
            y="0"
            width={(solve?.[1] ?? frames) - (solve?.[0] ?? 0)}
            height="100"
          />
        ))}
        <path class="doubt" d={bars.join("")} />
        <path class="now" d={`M${store.frame.value} 0h1v100h-1z`} />
      </svg>
      {clusters.corrections
        .filter(({ frame }) => isShown(frame, span))
        .map(({ frame }) => (
          <button
            key={frame}
            type="button"
            class="key-mark"
            aria-label={`Corrected clusters at frame ${frame + 1}`}
            title={`Corrected clusters at frame ${frame + 1}`}
            style={{ left: `${100 * shareOf(frame + 0.5, span)}%` }}
            onClick={() => store.goTo(frame)}
          />
        ))}
    </div>
  );
}
