/** The card over the picture while no session runs: the ways to begin, or the fault and its remedy. */

import type { Problem } from "../api/api";
import { Icon, type IconName } from "../ui/icons";
import { ProblemBlock } from "../ui/notices";
import { KINDS } from "./source-choice";
import type { SourceKind } from "./types";

const WAYS: Record<SourceKind, [IconName, string]> = {
  camera: ["camera", "Use the camera"],
  screen: ["screen", "Share the screen"],
  file: ["film", "Play a video"],
};

export interface InvitationProps {
  /** Why the last session did not begin, or ended. */
  problem: Problem | null;
  onchoose(kind: SourceKind): void;
  /** Try the same once more. */
  again(): void;
}

export function Invitation({ problem, onchoose, again }: InvitationProps) {
  return (
    <div class="live-invitation">
      <div class="live-card">
        {problem ? <Fault problem={problem} onchoose={onchoose} again={again} /> : <Ways onchoose={onchoose} />}
      </div>
    </div>
  );
}

function Ways({ onchoose }: Pick<InvitationProps, "onchoose">) {
  const kinds: SourceKind[] = window.isSecureContext ? KINDS : ["file"];
  return (
    <>
      <h2>Live painting</h2>
      <p>{window.isSecureContext ? "See your camera's picture painted while you move." : insecure()}</p>
      <div class="live-ways">
        {kinds.map((kind, i) => (
          <button key={kind} type="button" class={`button ${i === 0 ? "primary" : ""}`} onClick={() => onchoose(kind)}>
            <Icon name={WAYS[kind][0]} />
            {WAYS[kind][1]}
          </button>
        ))}
      </div>
      <p class="drop-hint">or drop a video here. Frames go to this service only, and none is kept.</p>
    </>
  );
}

function Fault({ problem, onchoose, again }: InvitationProps & { problem: Problem }) {
  return (
    <ProblemBlock error={problem}>
      <button type="button" class="button primary" onClick={again}>
        Try again
      </button>
      {problem.code !== "offline" && (
        <button type="button" class="button" onClick={() => onchoose("file")}>
          Play a video
        </button>
      )}
    </ProblemBlock>
  );
}

function insecure(): string {
  const local = `http://localhost${location.port && `:${location.port}`}/live`;
  return `Browsers give cameras to secure pages only, and ${location.origin} is not one. Open this page on the machine itself (${local}) or put the service behind HTTPS. A video works here too.`;
}
