/** A project that somebody has shared by a link: its video and its finished films, to look at only. */

import * as api from "../api/api";
import { under } from "../api/base";
import { outputOf } from "../api/formats";
import type { Job, Page } from "../api/schemas";
import { ago } from "../ui/format";
import { type SharedFilm, WholeSharedFilm } from "./shared-film";

export interface Shared {
  /** Address of the shared project in the API. */
  at: string;
  project: {
    name: string;
    updated_at: number;
    document: { assets: Record<string, { id: string }>; shots: { video: string }[] };
  };
  finished: Job[];
  film: SharedFilm;
}

export async function readShared(token: string): Promise<Shared> {
  const at = api.url`/v1/shared/${token}`;
  const [project, { items }, film] = await Promise.all([
    api.get<Shared["project"]>(at),
    api.get<Page<{ job: Job | null }>>(`${at}/jobs`),
    api.get<SharedFilm>(`${at}/film`),
  ]);
  return { at, project, film, finished: items.flatMap(({ job }) => (job?.state === "succeeded" ? [job] : [])) };
}

export function SharedPage({ at, project, finished, film }: Shared) {
  const shot = project.document.shots[0];
  const original = shot && project.document.assets[shot.video]?.id;
  return (
    <div class="shared-page">
      <h1>{project.name}</h1>
      <p class="hint">{`Shared with you to look at${film.comments ? " and to comment on" : ""}. Changed ${ago(project.updated_at)}.`}</p>
      {film.version !== null && <WholeSharedFilm at={at} film={film} name={project.name} />}
      {film.version !== null && film.chapters.length > 1 ? (
        <details>
          <summary>Films of single shots</summary>
          <Finished at={at} name={project.name} finished={finished} />
        </details>
      ) : (
        film.version === null && <Finished at={at} name={project.name} finished={finished} />
      )}
      {original && (
        <section>
          <h2>Original</h2>
          <Video src={`${at}/assets/${original}/content`} label="The original video" />
        </section>
      )}
    </div>
  );
}

function Finished({ at, name, finished }: { at: string; name: string; finished: readonly Job[] }) {
  if (!finished.length) return <p>No film of it is finished yet.</p>;
  return (
    <ul class="shared-films">
      {finished.map((job) => (
        <li key={job.id}>
          <h2>{job.request.name || name}</h2>
          <Film job={job} title={job.request.name || name} path={`${at}/jobs/${job.id}/result`} />
        </li>
      ))}
    </ul>
  );
}

function Film({ job, title, path }: { job: Job; title: string; path: string }) {
  const { shownAs, file } = outputOf(job.request.output?.format);
  if (shownAs === "video") return <Video src={path} label={title} />;
  return (
    <a class="button" href={under(path)} download="">
      {`Download ${file}`}
    </a>
  );
}

const Video = ({ src, label }: { src: string; label: string }) => (
  <video src={under(src)} controls muted playsInline preload="metadata" aria-label={label} />
);
