/** The user's projects on the start page, most recently changed first. Nothing is shown where there are none. */

import { deleteProject, listProjects, type ProjectInfo } from "../designer/api";
import { asProblem } from "../shared/api";
import { fill, h } from "../shared/dom";
import { ago } from "../shared/format";
import { iconButton } from "../shared/icons";
import { notify, offerUndo } from "../shared/notices";

const SHOWN = 6;

export function createProjectList(): HTMLElement {
  const list = h("ul", { class: "project-list" });
  const element = h("section", { class: "recent", hidden: true }, h("h2", {}, "Your projects"), list);
  load().catch((error) => {
    if (asProblem(error).status !== 404) notify(error);
  });

  async function load(): Promise<void> {
    const { items } = await listProjects(SHOWN);
    element.hidden = !items.length;
    fill(list, items.map(entry));
  }

  function entry(project: ProjectInfo): HTMLElement {
    const link = h(
      "a",
      { href: `#/projects/${project.id}` },
      h("strong", {}, project.name),
      h("span", {}, ago(project.updated_at)),
    );
    const remove = iconButton("trash", `Delete the project ${project.name}`, () => {
      item.hidden = true;
      const undo = () => {
        item.hidden = false;
      };
      offerUndo(`Deleted “${project.name}”.`, undo, () => deleteProject(project.id).catch(notify));
    });
    const item = h("li", {}, link, remove);
    return item;
  }

  return element;
}
