/** What is being set up in the studio, kept in the address so that a reload or a link brings it back. */

/**
 * @typedef {object} Draft
 * @property {string} method, video its name and the asset's id, or empty
 * @property {Object<string, string>} inputs other inputs: name to asset id
 * @property {object} params only those that differ from the defaults
 * @property {object} film output, seed and name, as the film form has them
 * @property {number|null} frame the previewed one
 */

/** @returns {Draft} */
export function readDraft(query) {
  const found = new URLSearchParams(query);
  return {
    method: found.get("method") ?? "",
    video: found.get("video") ?? "",
    inputs: Object.fromEntries([...found].filter(([k]) => k.startsWith("in.")).map(([k, v]) => [k.slice(3), v])),
    params: json(found.get("params")),
    film: json(found.get("film")),
    frame: found.has("frame") ? Number(found.get("frame")) : null,
  };
}

/** The studio's address for a draft. */
export function draftHash({ method, video, inputs = {}, params = {}, film = {}, frame = null }) {
  const query = new URLSearchParams();
  if (method) query.set("method", method);
  if (video) query.set("video", video);
  for (const [name, id] of Object.entries(inputs)) query.set(`in.${name}`, id);
  if (Object.keys(params).length) query.set("params", JSON.stringify(params));
  if (Object.keys(film).length) query.set("film", JSON.stringify(film));
  if (frame !== null) query.set("frame", String(frame));
  return `#/?${query}`;
}

/** The address of the studio set as it was for a job. */
export function hashOfJob({ request }) {
  const { video, ...inputs } = request.inputs;
  return draftHash({ method: request.method, video, inputs, params: request.params });
}

function json(text) {
  try {
    return JSON.parse(text ?? "{}") ?? {};
  } catch {
    return {};
  }
}
