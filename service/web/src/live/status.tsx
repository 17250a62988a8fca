/** The state of the session in words: a pill above the picture, and a line on it while the user has to wait. */

import { useEffect, useState } from "preact/hooks";

const WORDS = {
  idle: ["Not running", ""],
  asking: ["Waiting for your permission", "Allow it in the browser’s question"],
  opening: ["Opening", "Opening the video…"],
  connecting: ["Connecting", "Connecting…"],
  starting: ["Live", "Painting the first frame…"],
  live: ["Live", ""],
  paused: ["Paused while the tab is hidden", ""],
  busy: ["All sessions are in use", "All sessions are in use. Trying again"],
  lost: ["Connection lost", "Connection lost. Trying again"],
  failed: ["Stopped", ""],
} as const;

export interface Status {
  name: keyof typeof WORDS;
  /** Time of the next attempt, on the clock of `performance.now()`; 0: there is none. */
  until: number;
}

const WAITING: Status["name"][] = ["asking", "opening", "connecting", "starting", "busy", "lost"];

export const isWaiting = ({ name }: Status): boolean => WAITING.includes(name);
export const isRunning = ({ name }: Status): boolean => name !== "idle" && name !== "failed";

export function Pill({ status: { name } }: { status: Status }) {
  return (
    <p class="live-pill" data-state={name}>
      <span class="live-dot" aria-hidden="true" />
      <span role="status">{WORDS[name][0]}</span>
    </p>
  );
}

/** Over the picture. The seconds are shown only, since reading each one out would be a nuisance. */
export function WaitingLine({ status: { name, until } }: { status: Status }) {
  const [, tick] = useState(0);
  useEffect(() => {
    if (until <= performance.now()) return;
    const timer = setInterval(() => tick((n) => n + 1), 250);
    return () => clearInterval(timer);
  }, [until]);
  const seconds = Math.ceil((until - performance.now()) / 1000);
  const words = WORDS[name][1];
  return (
    <>
      <div class="stage-busy" />
      <p class="stage-status" aria-hidden="true">
        {words && until ? `${words}${seconds > 0 ? ` in ${seconds} s` : " now"}…` : words}
      </p>
    </>
  );
}
