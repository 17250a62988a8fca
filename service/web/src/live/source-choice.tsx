/** Choosing a camera, the screen, or a file. */

import { signal } from "@preact/signals";
import { useId } from "preact/hooks";
import { ACCEPT, Dropzone } from "../forms/dropzone";
import { Icon } from "../ui/icons";
import { listCameras, type Source, type SourceWishes } from "./source";
import type { SourceKind } from "./types";

const TITLES: Record<SourceKind, string> = { camera: "Camera", screen: "Screen", file: "Video file" };
const ALL: SourceKind[] = ["camera", "screen", "file"];
const HAS_SCREEN = !navigator.mediaDevices || "getDisplayMedia" in navigator.mediaDevices;
/** The sources that this browser has. */
export const KINDS = ALL.filter((each) => each !== "screen" || HAS_SCREEN);

export class SourceChoice {
  readonly kind = signal<SourceKind>(window.isSecureContext ? "camera" : "file");
  readonly file = signal<File | null>(null);
  readonly cameras = signal<{ deviceId: string; label: string }[]>([]);
  readonly device = signal("");
  /** The element whose file input asks for a video. */
  picker: HTMLElement | null = null;

  /** `onchoose` is called when the user chose another source. */
  constructor(private readonly onchoose: () => void) {}

  choose(kind: SourceKind): void {
    this.kind.value = kind;
    if (kind !== "file" || this.file.peek()) this.onchoose();
  }

  take(file: File): void {
    this.file.value = file;
    this.choose("file");
  }

  chooseCamera(deviceId: string): void {
    this.device.value = deviceId;
    this.onchoose();
  }

  /** Choose the other camera. */
  next(): void {
    const ids = this.cameras.peek().map(({ deviceId }) => deviceId);
    this.chooseCamera(ids[(ids.indexOf(this.device.peek()) + 1) % ids.length] ?? "");
  }

  /** Whether there is more than one camera. */
  get several(): boolean {
    return this.kind.value === "camera" && this.cameras.value.length > 1;
  }

  wishes(): Pick<SourceWishes, "deviceId" | "file"> {
    return { deviceId: this.cameras.peek().length > 1 ? this.device.peek() : "", file: this.file.peek() };
  }

  /** Open the file dialog. */
  pick(): void {
    this.picker?.querySelector<HTMLInputElement>("input[type=file]")?.click();
  }

  /** List the cameras, now that one is allowed. */
  async refresh(source: Source): Promise<void> {
    this.cameras.value = await listCameras();
    this.device.value = source.deviceId;
  }
}

export function SourceChooser({ choice }: { choice: SourceChoice }) {
  const name = useId();
  const { kind, file, cameras, device } = choice;
  return (
    <div
      class="source-choice"
      ref={(element) => {
        choice.picker = element;
      }}
    >
      <div class="segments" role="radiogroup" aria-label="Source">
        {KINDS.map((each) => (
          <label key={each} class="segment">
            <input
              type="radio"
              name={name}
              value={each}
              checked={each === kind.value}
              onChange={() => choice.choose(each)}
            />
            <span>{TITLES[each]}</span>
          </label>
        ))}
      </div>
      <select
        aria-label="Camera"
        hidden={!choice.several}
        value={device.value}
        onChange={(event) => choice.chooseCamera(event.currentTarget.value)}
      >
        {cameras.value.map(({ deviceId, label }, i) => (
          <option key={deviceId} value={deviceId}>
            {label || `Camera ${i + 1}`}
          </option>
        ))}
      </select>
      <Dropzone
        accept={ACCEPT.video.replace(",.zip", "")}
        label="Choose a video to play"
        onfiles={([given]) => given && choice.take(given)}
        class="drop-small"
        hidden={kind.value !== "file"}
      >
        <Icon name="film" />
        <span>{file.value?.name ?? "Drop a video or choose one; it plays in a loop."}</span>
      </Dropzone>
    </div>
  );
}
