/** The picture of a running job: its newest finished frame, and before that the original. */

import { useEffect, useRef, useState } from "preact/hooks";
import * as api from "../api/api";
import type { Job } from "../api/schemas";
import { Icon } from "../ui/icons";
import { revoke, useMediaUrl } from "../ui/media";
import { Still } from "../ui/stills";
import { isFinal } from "./progress";

const PREVIEW_MS = 1000;

export function JobPreview({ job }: { job: Job }) {
  const [ratio, setRatio] = useState(16 / 9);
  const newest = useNewestFrame(job);
  return (
    <div class="job-preview">
      <div class="frame" style={{ "--ratio": ratio || 16 / 9 }}>
        {newest ? (
          <img
            class="picture"
            alt="The newest finished frame"
            src={newest}
            onLoad={({ currentTarget: image }) => setRatio(image.naturalWidth / image.naturalHeight)}
          />
        ) : (
          <>
            <Original video={job.request.inputs.video ?? ""} onratio={setRatio} />
            <div class="preview-blank">
              <Icon name="brush" />
              <p>{isFinal(job) ? "Nothing was painted." : "The first frames appear here."}</p>
            </div>
          </>
        )}
      </div>
    </div>
  );
}

/** The first frame of the video; the service decodes it where the browser cannot. */
function Original({ video, onratio }: { video: string; onratio(ratio: number): void }) {
  const [unplayable, setUnplayable] = useState(false);
  const url = useMediaUrl(video && api.paths.content(video));
  if (unplayable)
    return (
      <Still
        asset={video}
        index={0}
        class="picture pending"
        onload={(image) => onratio(image.naturalWidth / image.naturalHeight)}
      />
    );
  return (
    <video
      class="picture pending"
      muted
      playsInline
      preload="auto"
      tabIndex={-1}
      aria-hidden="true"
      {...(url && { src: url })}
      onLoadedMetadata={({ currentTarget: film }) => onratio(film.videoWidth / film.videoHeight)}
      onError={() => url && setUnplayable(true)}
    />
  );
}

/** Address of the job's newest painted frame, read at most once a second; empty while there is none. */
function useNewestFrame(job: Job): string {
  const [url, setUrl] = useState("");
  const reading = useRef({ busy: false, last: 0, shown: "", closed: false });
  const name = ["preview", "poster"].find((file) => job.results.includes(file));
  useEffect(() => {
    const now = reading.current;
    if (!name || now.busy || Date.now() - now.last < PREVIEW_MS) return;
    now.busy = true;
    const show = async (found: string) => {
      const image = new Image();
      image.src = found;
      await image.decode().catch(() => {});
      revoke(now.shown);
      now.shown = found;
      if (now.closed) revoke(found);
      else setUrl(found);
    };
    api
      .objectUrl(api.paths.file(job.id, name))
      .then(show, () => {})
      .finally(() => Object.assign(now, { busy: false, last: Date.now() }));
  }, [job]);
  useEffect(
    () => () => {
      reading.current.closed = true;
      revoke(reading.current.shown);
    },
    [],
  );
  return url;
}
