/** Addresses of bytes of the service for media elements, which send no Authorization header. */

import { useEffect, useRef, useState } from "preact/hooks";
import { mediaUrl, objectUrl } from "../api/api";

/** The address that an element can load from `path`; empty until the first is known, and for an empty path. */
export const useMediaUrl = (path: string): string => useUrl(path, mediaUrl);

/** The bytes at `path` as an object URL; empty as above. */
export const useObjectUrl = (path: string): string => useUrl(path, objectUrl);

function useUrl(path: string, read: (path: string) => Promise<string>): string {
  const [url, setUrl] = useState("");
  const shown = useRef("");
  const show = (next: string) => {
    revoke(shown.current);
    shown.current = next;
    setUrl(next);
  };
  useEffect(() => {
    let left = false;
    if (path)
      read(path).then(
        (found) => (left ? revoke(found) : show(found)),
        () => {},
      );
    else show("");
    return () => {
      left = true;
    };
  }, [path]);
  useEffect(() => () => revoke(shown.current), []);
  return url;
}

/** Release the bytes behind an object URL; other addresses need nothing. */
export function revoke(url: string): void {
  if (url.startsWith("blob:")) URL.revokeObjectURL(url);
}
