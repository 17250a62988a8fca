/** The picture of the live page: the original and the painting, wiped, side by side, or the painting alone. */

import { signal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { useDrops } from "../forms/dropzone";
import { Wipe } from "../ui/wipe";
import type { Size } from "./types";

export type LiveView = "painted" | "wipe" | "beside";

/** Phones have no room for two pictures: they begin with the painting alone. */
const firstView = (): LiveView => (matchMedia("(max-width: 720px)").matches ? "painted" : "wipe");

export class Screen {
  readonly view = signal<LiveView>(firstView());
  readonly painted = signal(false);
  readonly mirrored = signal(false);
  readonly size = signal<Size>({ width: 16, height: 9 });
  readonly before = createSheet("The original");
  readonly after = createSheet("The painting");

  /** `onresize` is called before the painting gets another size. */
  constructor(private readonly onresize: () => void) {}

  /** The painting, whose stream is recorded. */
  get canvas(): HTMLCanvasElement {
    return this.after.canvas;
  }

  resize({ width, height }: Size): void {
    if (this.canvas.width === width && this.canvas.height === height) return;
    this.onresize();
    this.size.value = { width, height };
    for (const each of [this.before, this.after]) each.resize(width, height);
  }

  /** Show an answer, and the frame that it was made from. */
  paint(picture: CanvasImageSource, original: CanvasImageSource): void {
    this.after.draw(picture);
    if (this.view.peek() !== "painted") this.before.draw(original);
    this.painted.value = true;
  }

  /** Show the source itself, while there is no answer yet. */
  preview(picture: CanvasImageSource, size: Size): void {
    if (this.painted.peek()) return;
    this.resize(size);
    this.before.draw(picture);
  }

  clear(): void {
    this.painted.value = false;
    for (const each of [this.before, this.after]) each.clear();
  }
}

export interface ScreenViewProps {
  screen: Screen;
  busy: boolean;
  ondrop(file: File): void;
  /** Over the picture. */
  children: ComponentChildren;
}

export function ScreenView({ screen, busy, ondrop, children }: ScreenViewProps) {
  const { view, painted, mirrored, size } = screen;
  return (
    <div
      ref={useDrops<HTMLDivElement>(([file]) => file && ondrop(file))}
      class={`frame live-frame ${painted.value ? "painted" : ""} ${mirrored.value ? "mirrored" : ""}`}
      data-view={view.value}
      aria-busy={busy}
      style={{ "--ratio": size.value.width / size.value.height }}
    >
      <Wipe
        before={<Sheet canvas={screen.before.canvas} />}
        after={<Sheet canvas={screen.after.canvas} />}
        alone={view.value === "painted" ? "after" : null}
      />
      {children}
    </div>
  );
}

/** The canvas outlives the element: a stream draws on it, and a recorder reads it. */
const Sheet = ({ canvas }: { canvas: HTMLCanvasElement }) => (
  <div class="live-sheet" ref={(host) => host?.replaceChildren(canvas)} />
);

function createSheet(label: string) {
  const canvas = Object.assign(document.createElement("canvas"), { className: "picture", width: 16, height: 9 });
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", label);
  const context = canvas.getContext("2d", { alpha: false });
  return {
    canvas,
    draw(picture: CanvasImageSource) {
      if (!context) return;
      context.imageSmoothingQuality = "high"; // the service may paint at a smaller size; resizing a canvas resets this
      context.drawImage(picture, 0, 0, canvas.width, canvas.height);
    },
    /** Keeps the shown picture, so that it does not flash when a phone is rotated. */
    resize(width: number, height: number) {
      const shown = Object.assign(document.createElement("canvas"), { width, height });
      shown.getContext("2d")?.drawImage(canvas, 0, 0, width, height);
      Object.assign(canvas, { width, height });
      context?.drawImage(shown, 0, 0);
    },
    clear: () => context?.clearRect(0, 0, canvas.width, canvas.height),
  };
}
