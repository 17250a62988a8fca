/** One frame of the uploaded film: shown by the browser itself, or by the service where the browser cannot play it. */

import { useEffect, useRef, useState } from "preact/hooks";
import { mediaUrl, paths } from "../api/api";
import type { Asset } from "../api/schemas";
import { revoke } from "../ui/media";
import { mayPlay, Still } from "../ui/stills";

export interface OriginalProps {
  asset: Asset;
  /** Object URL of the file just chosen, which needs no download. */
  localUrl: string | undefined;
  frame: number;
  onfail(): void;
}

export function Original({ asset, localUrl, frame, onfail }: OriginalProps) {
  const [playable, setPlayable] = useState(mayPlay(asset));
  /** Before its first seek ends, a video shows its first frame. */
  const [sought, setSought] = useState(false);
  const film = useRef<HTMLVideoElement>(null);
  const fps = asset.info.fps || 25;
  const seek = () => {
    if (film.current) film.current.currentTime = (frame + 0.5) / fps;
  };
  useEffect(() => {
    const video = film.current;
    if (!video) return;
    const found = localUrl ? Promise.resolve(localUrl) : mediaUrl(paths.content(asset.id));
    found.then((url) => {
      video.src = url;
    }, onfail);
    return () => {
      revoke(video.src);
      video.removeAttribute("src");
      video.load();
    };
  }, [playable]);
  useEffect(() => {
    if ((film.current?.readyState ?? 0) > 0) seek();
  }, [frame]);
  if (!playable) return <Still asset={asset.id} index={frame} alt="The frame, original" onfail={onfail} />;
  return (
    <video
      ref={film}
      class="picture"
      muted
      playsInline
      preload="auto"
      aria-label="The frame, original"
      style={{ visibility: sought ? "visible" : "hidden" }}
      onSeeked={() => setSought(true)}
      onLoadedMetadata={({ currentTarget: video }) => (video.videoWidth ? seek() : setPlayable(false))}
      onError={({ currentTarget: video }) => video.hasAttribute("src") && setPlayable(false)}
    />
  );
}
