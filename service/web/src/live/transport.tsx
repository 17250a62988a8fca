/** The row under the picture: record, view, mirror, other camera, full screen. */

import { bytes, clock } from "../ui/format";
import { Icon, IconButton } from "../ui/icons";
import { canRecord } from "./recorder";
import type { LiveView, Screen } from "./screen";
import { canSendSound } from "./sound-sender";

const VIEWS: [string, LiveView][] = [
  ["Painted", "painted"],
  ["Compare", "wipe"],
  ["Side by side", "beside"],
];

/** What has been recorded so far. */
export interface Recorded {
  seconds: number;
  bytes: number;
}

export interface TransportProps {
  screen: Screen;
  /** The element that fills the screen. */
  stage: { current: HTMLElement | null };
  /** Null: nothing is being recorded. */
  recorded: Recorded | null;
  /** Whether there is a picture to record. */
  running: boolean;
  /** Whether there is another camera to switch to. */
  several: boolean;
  /** Whether recordings have sound. */
  sound: boolean;
  onrecord(): void;
  onsound(): void;
  onflip(): void;
  /** Whether viewers hear the sound. */
  sending: boolean;
  onsending(): void;
}

export function Transport(props: TransportProps) {
  const { screen, stage, recorded, running, several, sound, onrecord, onsound, onflip, sending, onsending } = props;
  const { view, mirrored } = screen;
  const length = recorded?.seconds
    ? `Stop · ${clock(recorded.seconds).slice(0, -2)}${recorded.bytes ? ` · ${bytes(recorded.bytes)}` : ""}`
    : "Stop recording";
  return (
    <div class="transport live-transport">
      {canRecord() && (
        <button
          type="button"
          class="button small live-record"
          aria-pressed={Boolean(recorded)}
          disabled={!running && !recorded}
          onClick={onrecord}
        >
          <Icon name="record" />
          <span>{recorded ? length : "Record"}</span>
        </button>
      )}
      {canRecord() && (
        <IconButton
          name={sound ? "sound" : "muted"}
          label="Sound of the microphone, tab or file"
          pressed={sound}
          disabled={Boolean(recorded)}
          onClick={onsound}
        />
      )}
      {canSendSound() && (
        <IconButton name="broadcast" label="Viewers hear the sound" pressed={sending} onClick={onsending} />
      )}
      <div class="views" role="group" aria-label="View">
        {VIEWS.map(([text, name]) => (
          <button
            key={name}
            type="button"
            aria-pressed={view.value === name}
            onClick={() => {
              view.value = name;
            }}
          >
            {text}
          </button>
        ))}
      </div>
      {several && <IconButton name="turn" label="Other camera" onClick={onflip} />}
      <IconButton
        name="mirror"
        label="Mirror the picture"
        pressed={mirrored.value}
        onClick={() => {
          mirrored.value = !mirrored.value;
        }}
      />
      {document.fullscreenEnabled && (
        <IconButton
          name="full"
          label="Full screen"
          onClick={() => {
            if (document.fullscreenElement) document.exitFullscreen();
            else stage.current?.requestFullscreen();
          }}
        />
      )}
    </div>
  );
}
