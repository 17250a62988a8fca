/** A project that somebody has shared by a link: its video and its finished films, to look at only. */

import * as api from "../api/api";
import { under } from "../api/base";
import { outputOf } from "../api/formats";
import type { Job, Page } from "../api/schemas";
import { ago } from "../ui/format";

export interface Shared {
  /** Address of the shared project in the API. */
  at: string;
  project: {
    name: string;
    updated_at: number;
    document: { assets: Record<string, { id: string }>; shots: { video: string }[] };
  };
  finished: Job[];
}

export async function readShared(token: string): Promise<Shared> {
  const at = api.url`/v1/shared/${token}`;
  const [project, { items }] = await Promise.all([
    api.get<Shared["project"]>(at),
    api.get<Page<{ job: Job | null }>>(`${at}/jobs`),
  ]);
  return { at, project, finished: items.flatMap(({ job }) => (job?.state === "succeeded" ? [job] : [])) };
}

export function SharedPage({ at, project, finished }: Shared) {
  const shot = project.document.shots[0];
  const original = shot && project.document.assets[shot.video]?.id;
  return (
    <div class="shared-page">
      <h1>{project.name}</h1>
      <p class="hint">{`Shared with you to look at. Changed ${ago(project.updated_at)}.`}</p>
      {finished.length ? (
        <ul class="shared-films">
          {finished.map((job) => (
            <li key={job.id}>
              <h2>{job.request.name || project.name}</h2>
              <Film job={job} title={job.request.name || project.name} path={`${at}/jobs/${job.id}/result`} />
            </li>
          ))}
        </ul>
      ) : (
        <p>No film of it is finished yet.</p>
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
