/** Single frames of an asset, decoded by the service: for videos that the browser itself cannot play. */

import { useEffect, useRef } from "preact/hooks";
import * as api from "../api/api";
import type { Asset } from "../api/schemas";
import { revoke } from "./media";

const SIDE_PX = 854;

/** Whether the browser may be able to play the asset; it can still find out that it cannot. */
export const mayPlay = (asset: Asset): boolean =>
  asset.media_type.startsWith("video/") && document.createElement("video").canPlayType(asset.media_type) !== "";

export interface Stills {
  /** Show a frame; fractions are cut. One request runs at a time: of many indices the newest counts. */
  show(index: number): void;
  close(): void;
}

/** Show frames of an asset in `image`. `onfail` is called when one cannot be read. */
export function showStills(image: HTMLImageElement, assetId: string, onfail = () => {}): Stills {
  const controller = new AbortController();
  let wanted = 0;
  let shown = -1;
  let busy = false;

  async function next(): Promise<void> {
    if (busy || controller.signal.aborted || wanted === shown) return;
    busy = true;
    shown = wanted;
    await api.objectUrl(api.paths.frame(assetId, wanted, SIDE_PX), controller.signal).then(swap, failed);
    busy = false;
    next();
  }

  async function swap(url: string): Promise<void> {
    const old = image.src;
    image.src = url;
    await image.decode().catch(() => {});
    revoke(old);
  }

  function failed(problem: unknown): void {
    const busyNow = problem instanceof api.Problem && problem.code === "busy";
    if (!busyNow && !controller.signal.aborted) onfail();
  }

  return {
    show(index) {
      wanted = Math.max(0, Math.floor(index));
      next();
    },
    close() {
      controller.abort();
      revoke(image.src);
    },
  };
}

export interface StillProps {
  asset: string;
  index: number;
  /** Instead of "picture". */
  class?: string;
  alt?: string;
  onfail?(): void;
  onload?(image: HTMLImageElement): void;
}

/** A frame of an asset. */
export function Still({ asset, index, class: style = "picture", alt = "", onfail, onload }: StillProps) {
  const element = useRef<HTMLImageElement>(null);
  const stills = useRef<Stills>(null);
  useEffect(() => {
    if (element.current) stills.current = showStills(element.current, asset, onfail);
    return () => stills.current?.close();
  }, [asset]);
  useEffect(() => stills.current?.show(index), [asset, index]);
  return (
    <img ref={element} class={style} decoding="async" alt={alt} onLoad={(event) => onload?.(event.currentTarget)} />
  );
}
