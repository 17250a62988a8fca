/** The user's projects on the start page, most recently changed first. Project files are opened here, too. */

import { asProblem } from "../api/api";
import { deleteProject, importProject, listProjects, type ProjectInfo } from "../studio/document/api";
import { fill, h } from "../ui/dom";
import { ago } from "../ui/format";
import { iconButton } from "../ui/icons";
import { notify, offerUndo } from "../ui/notices";

const SHOWN = 6;

export function createProjectList(): HTMLElement {
  const list = h("ul", { class: "project-list" });
  const chosen = h("input", {
    type: "file",
    accept: ".zip",
    class: "visually-hidden",
    "aria-label": "Open a project file",
  });
  chosen.addEventListener("change", () => {
    const [file] = chosen.files ?? [];
    if (file) open(file).catch(notify);
  });
  const head = h(
    "div",
    { class: "latest-head" },
    h("h2", {}, "Your projects"),
    h("label", { class: "button small" }, "Open a project file", chosen),
  );
  const element = h("section", { class: "recent", hidden: true }, head, list);
  load().catch((error) => {
    if (asProblem(error).status !== 404) notify(error);
  });

  async function open(file: File): Promise<void> {
    location.hash = `#/projects/${(await importProject(file)).id}`;
  }

  async function load(): Promise<void> {
    const { items } = await listProjects(SHOWN);
    element.hidden = false;
    list.hidden = !items.length;
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
