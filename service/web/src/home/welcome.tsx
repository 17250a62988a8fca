/** The studio before there is a video: drop one, pick one, or try the sample. */

import { useEffect, useRef, useState } from "preact/hooks";
import { asProblem, isAbort, type Problem, request } from "../api/api";
import { under } from "../api/base";
import type { Asset } from "../api/schemas";
import { ACCEPT, Dropzone, useDrops } from "../forms/dropzone";
import { bytes, percent } from "../ui/format";
import { Icon } from "../ui/icons";
import { ProblemBlock } from "../ui/notices";
import { upload } from "../ui/upload";

const SAMPLE = { path: "/static/media/sample.mp4", name: "flower.mp4" };

export interface WelcomeProps {
  /** Called with an uploaded video and its file. */
  onasset(asset: Asset, file: File): void;
  /** Called with several uploaded videos: the shots of a film. */
  onfilm(clips: Asset[]): Promise<void>;
  /** Open the first project, which explains keys. */
  onlearn(): Promise<void>;
}

export function Welcome({ onasset, onfilm, onlearn }: WelcomeProps) {
  const [sending, setSending] = useState<SendingProps | null>(null);
  const [problem, setProblem] = useState<Problem | null>(null);
  const [opening, setOpening] = useState(false);
  const life = useRef(new AbortController());
  useEffect(() => () => life.current.abort(), []);

  async function take(files: readonly File[]): Promise<void> {
    if (sending) return;
    setProblem(null);
    const clips: Asset[] = [];
    try {
      for (const [i, file] of files.entries()) {
        const count = files.length > 1 ? { number: i + 1, of: files.length } : undefined;
        const onProgress = (sent: number | null) => setSending({ file, sent, count });
        onProgress(null);
        clips.push(await upload(file, { onProgress, signal: life.current.signal }));
      }
      if (clips.length > 1) await onfilm(clips);
      else if (clips[0] && files[0]) onasset(clips[0], files[0]);
    } catch (error) {
      if (!isAbort(error)) setProblem(asProblem(error));
    }
    setSending(null);
  }

  async function trySample(): Promise<void> {
    try {
      const answer = await request(SAMPLE.path);
      await take([new File([await answer.blob()], SAMPLE.name, { type: "video/mp4" })]);
    } catch (error) {
      setProblem(asProblem(error));
    }
  }

  async function learn(): Promise<void> {
    setOpening(true);
    await onlearn().catch((error) => setProblem(asProblem(error)));
    setOpening(false);
  }

  return (
    <section class="welcome" ref={useDrops<HTMLElement>(take)}>
      <div class="welcome-text">
        <h1>
          Video in, <em>painting</em> out.
        </h1>
        <p class="lede">
          Impasto turns video into cartoons and paintings that stay steady from frame to frame: no shimmer, no crawling
          lines.
        </p>
        <div class="starts">
          <button type="button" class="sample" onClick={trySample}>
            <img src={under("/static/img/sample.jpg")} alt="" width={100} height={72} />
            <span>
              No clip at hand?<strong>Try the sample</strong>
            </span>
          </button>
          <button type="button" class="sample learn" disabled={opening} onClick={learn}>
            <Icon name="brush" />
            <span>
              New here?<strong>Learn painted keys in two minutes</strong>
            </span>
          </button>
        </div>
        <p class="guide-link">
          <a href={under("/docs/shot")}>Guide: paint a shot in ten minutes</a>
        </p>
      </div>
      <div class="welcome-drop">
        <Dropzone
          accept={ACCEPT.video}
          label="Choose a video"
          onfiles={take}
          multiple
          class={`drop-large ${sending ? "busy" : ""}`}
        >
          <div class="drop-inside">{sending ? <Sending {...sending} /> : <Invitation />}</div>
        </Dropzone>
        <div class="welcome-fault">{problem && <ProblemBlock error={problem} />}</div>
      </div>
    </section>
  );
}

const Invitation = () => (
  <>
    <span class="drop-title">Drop a video here</span>
    <span class="drop-or">or</span>
    <span class="button primary" aria-hidden="true">
      Choose a video
    </span>
    <span class="drop-hint">
      A video, an image, or a zip of numbered frames; several clips become the shots of a film
    </span>
  </>
);

interface SendingProps {
  file: File;
  /** Fraction; null before the first byte. */
  sent: number | null;
  /** Of several clips. */
  count: { number: number; of: number } | undefined;
}

/** The upload inside the drop zone. */
function Sending({ file, sent, count }: SendingProps) {
  const text =
    sent === null ? "Starting…" : sent < 1 ? `${percent(sent)} of ${bytes(file.size)}` : "Reading the video…";
  return (
    <>
      <span class="drop-title drop-name">{file.name}</span>
      <progress max={1} value={sent ?? 0} aria-label="Upload" />
      <span class="drop-hint" role="status">
        {count && `Clip ${count.number} of ${count.of}: `}
        {text}
      </span>
    </>
  );
}
