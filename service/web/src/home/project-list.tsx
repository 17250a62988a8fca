/** The user's projects on the start page, most recently changed first. Project files are opened here, too. */

import { useEffect, useState } from "preact/hooks";
import { asProblem } from "../api/api";
import { deleteProject, importProject, listProjects, type ProjectInfo } from "../studio/document/api";
import { ago } from "../ui/format";
import { IconButton } from "../ui/icons";
import { notify, offerUndo } from "../ui/notices";

const SHOWN = 6;

export function ProjectList() {
  const [projects, setProjects] = useState<ProjectInfo[] | null>(null);
  useEffect(() => {
    listProjects(SHOWN).then(
      ({ items }) => setProjects(items),
      (error) => asProblem(error).status === 404 || notify(error),
    );
  }, []);
  const open = async (file: File) => {
    location.hash = `#/projects/${(await importProject(file)).id}`;
  };
  if (!projects) return null;
  return (
    <section class="recent">
      <div class="latest-head">
        <h2>Your projects</h2>
        <label class="button small">
          Open a project file
          <input
            type="file"
            accept=".zip"
            class="visually-hidden"
            aria-label="Open a project file"
            onChange={({ currentTarget: { files } }) => files?.[0] && open(files[0]).catch(notify)}
          />
        </label>
      </div>
      {projects.length > 0 && (
        <ul class="project-list">
          {projects.map((project) => (
            <Entry key={project.id} project={project} />
          ))}
        </ul>
      )}
    </section>
  );
}

function Entry({ project }: { project: ProjectInfo }) {
  const [deleted, setDeleted] = useState(false);
  const remove = () => {
    setDeleted(true);
    const leave = () => deleteProject(project.id).catch(notify);
    offerUndo(`Deleted “${project.name}”.`, () => setDeleted(false), leave);
  };
  return (
    <li hidden={deleted}>
      <a href={`#/projects/${project.id}`}>
        <strong>{project.name}</strong>
        <span>{ago(project.updated_at)}</span>
      </a>
      <IconButton name="trash" label={`Delete the project ${project.name}`} onClick={remove} />
    </li>
  );
}
