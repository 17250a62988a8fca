/** The path under which a proxy serves the pages, from the address of this module; "" at the root of a host. */
export const base = /^(.*)\/static\//.exec(new URL(import.meta.url).pathname)?.[1] ?? "";

/** A path of this service, behind the proxy's prefix; a path that has it already is returned as it is. */
export const under = (path: string): string =>
  base && path.startsWith("/") && !path.startsWith(`${base}/`) ? base + path : path;
