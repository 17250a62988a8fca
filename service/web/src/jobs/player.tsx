/** Two films in step, one over the other: the painted film leads, the original follows, frame by frame if it cannot play. */

import { useEffect, useRef, useState } from "preact/hooks";
import type { Asset } from "../api/schemas";
import { clock } from "../ui/format";
import { IconButton } from "../ui/icons";
import { type Stills, showStills } from "../ui/stills";
import { type Side, Wipe } from "../ui/wipe";

const SEEK_BEYOND_S = 0.2;
const NUDGE_BEYOND_S = 0.02;
const calm = (): boolean => matchMedia("(prefers-reduced-motion: reduce)").matches;

export interface PlayerProps {
  /** The original. */
  asset: Asset;
  /** Address of the original, or empty where the browser cannot play it. */
  before: string;
  /** Address of the painted film. */
  after: string;
  poster?: string;
  /** The original's frame that the painted film begins with. */
  first?: number;
  labels?: readonly [before: string, after: string];
  /** Stop at this frame of the painted film; a new object each time. */
  wanted?: { frame: number } | null;
  /** Called with the number of the film's frame at which it stops. */
  onframe?(frame: number): void;
}

export function Player(props: PlayerProps) {
  const { asset, before, after, poster, first = 0, labels = ["Original", "Painted"], wanted, onframe } = props;
  const [playable, setPlayable] = useState(Boolean(before));
  const [original, setOriginal] = useState(true);
  const [alone, setAlone] = useState<Side | null>(null);
  const player = useRef<HTMLDivElement>(null);
  const leader = useRef<HTMLVideoElement>(null);
  const follower = useRef<HTMLVideoElement>(null);
  const still = useRef<HTMLImageElement>(null);
  const fps = asset.info.fps || 25;

  useEffect(() => {
    const [film, image] = [leader.current, still.current];
    if (film && follower.current) return keepInStep(film, follower.current, first / fps);
    if (!film || !image) return;
    const fail = () => {
      setOriginal(false);
      setAlone("after");
    };
    return followByFrame(film, showStills(image, asset.id, fail), fps, first);
  }, [playable]);
  useEffect(() => {
    const film = leader.current;
    if (!calm()) film?.play().catch(() => {});
    return () => {
      film?.removeAttribute("src");
      film?.load();
    };
  }, []);
  useEffect(() => {
    if (!wanted || !leader.current) return;
    leader.current.pause();
    leader.current.currentTime = (wanted.frame + 0.5) / fps;
  }, [wanted]);

  const stopped = ({ currentTarget: film }: { currentTarget: HTMLVideoElement }) => {
    if (film.paused) onframe?.(Math.floor(film.currentTime * fps + 0.01));
  };
  const common = { class: "picture", playsInline: true, preload: "auto", loop: true, muted: true } as const;
  return (
    <div
      ref={player}
      class={`player ${original ? "" : "no-original"}`}
      role="group"
      aria-label="Player"
      onKeyDown={(event) => {
        if (event.key !== " " || (event.target as Element).closest("button, input")) return;
        event.preventDefault();
        toggle(leader.current);
      }}
    >
      <div class="frame" style={{ "--ratio": (asset.info.width ?? 16) / (asset.info.height ?? 9) }}>
        <Wipe
          labels={labels}
          alone={alone}
          before={
            playable ? (
              <video
                {...common}
                ref={follower}
                src={before}
                tabIndex={-1}
                aria-hidden="true"
                onError={() => setPlayable(false)}
                onLoadedMetadata={(event) => event.currentTarget.videoWidth || setPlayable(false)}
              />
            ) : (
              <img ref={still} class="picture" decoding="async" alt="" aria-hidden="true" />
            )
          }
          after={
            <video
              {...common}
              {...(poster && { poster })}
              ref={leader}
              src={after}
              aria-label="The painted film"
              onPause={stopped}
              onSeeked={stopped}
            />
          }
        />
      </div>
      <Transport leader={leader} player={player} labels={labels} alone={alone} setAlone={setAlone} />
    </div>
  );
}

function toggle(film: HTMLVideoElement | null): void {
  if (film?.paused) film.play().catch(() => {});
  else film?.pause();
}

/**
 * Let the follower do what the leader does, `startS` seconds further into its film; small drift is corrected by rate,
 * large drift by a seek.
 */
function keepInStep(leader: HTMLVideoElement, follower: HTMLVideoElement, startS: number): () => void {
  const controller = new AbortController();
  let pending = 0;
  const align = () => {
    follower.currentTime = Math.min(startS + leader.currentTime, follower.duration || Infinity);
  };
  const tick = () => {
    const drift = follower.currentTime - leader.currentTime - startS;
    if (Math.abs(drift) > SEEK_BEYOND_S && !follower.seeking) align();
    follower.playbackRate = leader.playbackRate * (Math.abs(drift) > NUDGE_BEYOND_S ? 1 - Math.sign(drift) * 0.1 : 1);
    pending = requestAnimationFrame(tick);
  };
  const play = () => {
    follower.play().catch(() => {});
    cancelAnimationFrame(pending);
    tick();
  };
  const pause = () => {
    cancelAnimationFrame(pending);
    follower.pause();
    align();
  };
  leader.addEventListener("play", play, controller);
  leader.addEventListener("pause", pause, controller);
  leader.addEventListener("seeking", align, controller);
  follower.addEventListener("loadedmetadata", align, controller);
  return () => {
    controller.abort();
    cancelAnimationFrame(pending);
    follower.removeAttribute("src");
    follower.load();
  };
}

/** Show the original's frame at the leader's time; while the film plays, as many as the service can decode. */
function followByFrame(leader: HTMLVideoElement, stills: Stills, fps: number, first: number): () => void {
  const controller = new AbortController();
  let pending = 0;
  const show = () => stills.show(first + leader.currentTime * fps + 0.01);
  const tick = () => {
    show();
    pending = requestAnimationFrame(tick);
  };
  const stop = () => cancelAnimationFrame(pending);
  const play = () => {
    stop();
    tick();
  };
  leader.addEventListener("play", play, controller);
  leader.addEventListener("pause", stop, controller);
  leader.addEventListener("seeked", show, controller);
  if (leader.paused) show();
  else tick();
  return () => {
    controller.abort();
    stop();
    stills.close();
  };
}

interface TransportProps {
  leader: { current: HTMLVideoElement | null };
  player: { current: HTMLElement | null };
  labels: readonly [string, string];
  alone: Side | null;
  setAlone(alone: Side | null): void;
}

/** Buttons and position below the films. */
function Transport({ leader, player, labels, alone, setAlone }: TransportProps) {
  const [state, setState] = useState({ paused: true, muted: true, at: 0, length: 0 });
  useEffect(() => {
    const controller = new AbortController();
    const film = leader.current;
    const read = () => {
      if (film) setState({ paused: film.paused, muted: film.muted, at: film.currentTime, length: film.duration || 0 });
    };
    for (const event of ["play", "pause", "volumechange", "timeupdate", "loadedmetadata", "seeked"])
      film?.addEventListener(event, read, controller);
    return () => controller.abort();
  }, []);
  const { paused, muted, at, length } = state;
  const views: [string, Side | null][] = [
    [labels[0], "before"],
    ["Compare", null],
    [labels[1], "after"],
  ];
  return (
    <div class="transport">
      <IconButton
        name={paused ? "play" : "pause"}
        label={paused ? "Play" : "Pause"}
        onClick={() => toggle(leader.current)}
      />
      <input
        type="range"
        min="0"
        max="1"
        step="any"
        aria-label="Position"
        aria-valuetext={clock(at)}
        value={at / (length || 1)}
        style={{ "--fill": at / (length || 1) }}
        onInput={(event) => {
          if (leader.current) leader.current.currentTime = Number(event.currentTarget.value) * length;
        }}
      />
      <output class="time">{length ? `${clock(at)} / ${clock(length)}` : "0:00.0"}</output>
      <IconButton
        name={muted ? "muted" : "sound"}
        label={muted ? "Sound on" : "Sound off"}
        onClick={() => {
          if (leader.current) leader.current.muted = !leader.current.muted;
        }}
      />
      <div class="views" role="group" aria-label="View">
        {views.map(([text, side]) => (
          <button key={text} type="button" aria-pressed={side === alone} onClick={() => setAlone(side)}>
            {text}
          </button>
        ))}
      </div>
      {document.fullscreenEnabled && (
        <IconButton
          name="full"
          label="Full screen"
          onClick={() => {
            if (document.fullscreenElement) document.exitFullscreen();
            else player.current?.requestFullscreen();
          }}
        />
      )}
    </div>
  );
}
