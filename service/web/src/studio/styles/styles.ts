/** The style library over HTTP. */

import { objectUrl, paths, url } from "../../api/api";
import { bodyOf, client } from "../../api/client";
import type { Schemas } from "../../api/schemas";

export type Style = Schemas["StyleOut"];

const SIDE_PX = 240;
let queue: Promise<unknown> = Promise.resolve();

export const listStyles = async (): Promise<Style[]> => (await bodyOf(client.GET("/v1/styles"))).items;

/** The painting, small, as an object URL. One request runs at a time: the service may have to paint it first. */
export function libraryPicture(id: string): Promise<string> {
  const next = queue.then(() => objectUrl(url`/v1/styles/${id}/picture?max_side_px=${SIDE_PX}`));
  queue = next.catch(() => {});
  return next;
}

/** An asset, small, as an object URL. */
export const pictureOfAsset = (id: string): Promise<string> => objectUrl(paths.frame(id, 0, SIDE_PX));

/** Make a painting of the library an asset of the user's. */
export const useStyle = (id: string): Promise<Schemas["StyleAssets"]> =>
  bodyOf(client.POST("/v1/styles/{style_id}/assets", { params: { path: { style_id: id } } }));
