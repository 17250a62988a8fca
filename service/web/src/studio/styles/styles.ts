/** The style library over HTTP. */

import { get, objectUrl, paths, request, url } from "../../api/api";
import type { Asset, Page } from "../../api/types";

export interface Style {
  id: string;
  title: string;
  /** Painted by Impasto itself, or a file of the operator's folder. */
  origin: "impasto" | "folder";
  credit: string;
  /** Whether the picture that it was painted from is known. */
  paired: boolean;
}

export interface StyleAssets {
  painting: Asset;
  source: Asset | null;
}

const SIDE_PX = 240;
let queue: Promise<unknown> = Promise.resolve();

export const listStyles = async (): Promise<Style[]> => (await get<Page<Style>>("/v1/styles")).items;

/** The painting, small, as an object URL. One request runs at a time: the service may have to paint it first. */
export function libraryPicture(id: string): Promise<string> {
  const next = queue.then(() => objectUrl(url`/v1/styles/${id}/picture?max_side_px=${SIDE_PX}`));
  queue = next.catch(() => {});
  return next;
}

/** An asset, small, as an object URL. */
export const pictureOfAsset = (id: string): Promise<string> => objectUrl(paths.frame(id, 0, SIDE_PX));

/** Make a painting of the library an asset of the user's. */
export const useStyle = async (id: string): Promise<StyleAssets> =>
  (await request(url`/v1/styles/${id}/assets`, { method: "POST" })).json();
