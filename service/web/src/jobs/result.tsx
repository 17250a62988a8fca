/** A finished film: the player, or the contact sheet where there is nothing a browser plays, and the downloads. */

import { useEffect, useState } from "preact/hooks";
import * as api from "../api/api";
import { outputOf } from "../api/formats";
import type { Job } from "../api/schemas";
import { artefactTitle } from "../ui/format";
import { Icon } from "../ui/icons";
import { useMediaUrl } from "../ui/media";
import { notify } from "../ui/notices";
import { mayPlay } from "../ui/stills";
import { Exports } from "./exports";
import { Player, type PlayerProps } from "./player";
import { QualityReport } from "./quality";

const NOT_FILES = ["result", "poster", "preview"];

/** `onframe` is called with the number of the film's frame at which the player stops. */
export function Result({ job, onframe }: { job: Job; onframe(frame: number): void }) {
  const [wanted, setWanted] = useState<{ frame: number } | null>(null);
  return (
    <div class="result-and-quality">
      <div class="result">
        <Film job={job} wanted={wanted} onframe={onframe} />
      </div>
      <QualityReport job={job} showFrame={(frame) => setWanted({ frame })} />
    </div>
  );
}

type FilmProps = { job: Job } & Pick<PlayerProps, "wanted" | "onframe">;

function Film({ job, ...playing }: FilmProps) {
  const { shownAs } = outputOf(job.request.output?.format);
  if (shownAs === "image") return <Sheet path={api.paths.result(job.id)} alt="The painted film" />;
  if (shownAs === "video") return <PlayedFilm job={job} {...playing} />;
  const name = ["sheet", "poster"].find((file) => job.results.includes(file));
  return name ? <Sheet path={api.paths.file(job.id, name)} alt="Contact sheet of the frames" /> : null;
}

function Sheet({ path, alt }: { path: string; alt: string }) {
  const src = useMediaUrl(path);
  return src ? <img class="sheet" alt={alt} src={src} /> : null;
}

function PlayedFilm({ job, ...playing }: FilmProps) {
  const [films, setFilms] = useState<PlayerProps | null>(null);
  useEffect(() => {
    let closed = false;
    filmsOf(job).then((found) => closed || setFilms(found), notify);
    return () => {
      closed = true;
    };
  }, [job.id]);
  return films && <Player {...films} {...playing} />;
}

async function filmsOf(job: Job): Promise<PlayerProps> {
  const asset = await api.asset(job.request.inputs.video ?? "");
  const [before, after, poster] = await Promise.all([
    mayPlay(asset) ? api.mediaUrl(api.paths.content(asset.id)) : "",
    api.mediaUrl(api.paths.result(job.id)),
    job.results.includes("poster") ? api.mediaUrl(api.paths.file(job.id, "poster")) : "",
  ]);
  return { asset, before, after, poster, first: job.request.frames?.[0] ?? 0 };
}

export function Downloads({ job }: { job: Job }) {
  const save = (path: string) => () => api.download(path).catch(notify);
  const others = job.results.filter((name) => !NOT_FILES.includes(name));
  return (
    <div class="downloads">
      <button type="button" class="button primary" onClick={save(api.paths.result(job.id))}>
        <Icon name="download" />
        {`Download ${outputOf(job.request.output?.format).file}`}
      </button>
      <Exports job={job} />
      {others.length > 0 && (
        <div class="downloads-more">
          {others.map((name) => (
            <button key={name} type="button" class="button small" onClick={save(api.paths.file(job.id, name))}>
              {name === "sheet" ? "Contact sheet" : artefactTitle(name)}
            </button>
          ))}
        </div>
      )}
    </div>
  );
}
