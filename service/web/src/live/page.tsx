/** The live page: one source, one stream, one screen, and the settings beside them. */

import { useRef } from "preact/hooks";
import { Invitation } from "./invitation";
import { Meters, type Painted } from "./meters";
import { ScreenView } from "./screen";
import type { Live } from "./session";
import { SettingsPanel } from "./settings";
import { smallWarning } from "./size-sentence";
import { isRunning, isWaiting, Pill, WaitingLine } from "./status";
import { Transport } from "./transport";
import type { SourceKind } from "./types";

const START: Record<SourceKind, string> = {
  camera: "Start the camera",
  screen: "Share the screen",
  file: "Play the video",
};

export function LivePage({ live }: { live: Live }) {
  const stage = useRef<HTMLElement>(null);
  const status = live.status.value;
  const running = isRunning(status);
  return (
    <div class="studio live">
      <div class="studio-stage">
        <div class="film-head">
          <div class="film-title">
            <h1>Live</h1>
            <p>{running ? live.about : "Paint a camera, a screen or a video while it runs."}</p>
          </div>
          <Pill status={status} />
        </div>
        <section class="player live-stage" aria-label="Picture" ref={stage}>
          <ScreenView screen={live.screen} busy={isWaiting(status)} ondrop={(file) => live.choice.take(file)}>
            <WaitingLine status={status} />
            {live.inviting.value && (
              <Invitation
                problem={live.problem.value}
                onchoose={(kind) => live.begin(kind)}
                again={() => live.start()}
              />
            )}
          </ScreenView>
          <Transport
            screen={live.screen}
            stage={stage}
            recorded={live.recorded.value}
            running={status.name === "live"}
            several={live.choice.several}
            sound={live.sound.on.value}
            onrecord={() => live.record()}
            onsound={() => live.toggleSound()}
            sending={live.sound.on.value && live.sender.on.value}
            onsending={() => live.toggleSending()}
            onflip={() => live.choice.next()}
          />
        </section>
        <SmallSize painted={live.painted.value} running={status.name === "live"} />
        <Figures live={live} />
      </div>
      <aside class="panel" aria-label="Settings">
        <SettingsPanel settings={live.settings} source={live.choice} scene={live.scene.value} />
        <div class="submit-bar">
          <p class="submit-hint">{live.summary}</p>
          <button
            type="button"
            class={`button submit ${running ? "" : "primary"}`}
            onClick={() => (running ? live.stop() : live.start())}
          >
            {running ? "Stop" : START[live.choice.kind.value]}
          </button>
        </div>
      </aside>
    </div>
  );
}

/** A warning while the service paints small pictures. */
function SmallSize({ painted, running }: { painted: Painted | null; running: boolean }) {
  const text = running && painted ? smallWarning(painted) : "";
  return (
    <p class="field-error live-small" role="status">
      {text}
    </p>
  );
}

/** Drawn anew once a second. */
function Figures({ live }: { live: Live }) {
  return (
    <Meters
      history={live.history.value}
      dropShare={live.dropShare.value}
      targetFps={live.settings.values().fps}
      painted={live.painted.value}
      codecs={live.codecs.value}
    />
  );
}
