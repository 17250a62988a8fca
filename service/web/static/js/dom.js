/** Building elements without templates: safe by construction, since text is only ever text. */

const SVG = "http://www.w3.org/2000/svg";

/**
 * Make an element. `on…` properties are listeners, `class` is the class, an own property of the element is assigned,
 * all else is an attribute; `null`, `undefined` and `false` are left out, both as properties and as children.
 */
export function h(tag, props = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(props)) assign(element, name, value);
  element.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

function assign(element, name, value) {
  if (value === null || value === undefined || value === false) return;
  if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
  else if (name === "class") element.className = value;
  else if (name in element && !name.includes("-") && typeof value !== "string") element[name] = value;
  else element.setAttribute(name, value === true ? "" : value);
}

/** Replace everything inside `element`. */
export function fill(element, ...children) {
  element.replaceChildren(...children.flat(Infinity).filter(Boolean));
}

let count = 0;
/** An id no other element has. */
export const unique = (prefix) => `${prefix}-${++count}`;

const ICONS = {
  play: "M8 5.5v13l11-6.5z",
  pause: "M7 5h4v14H7zM13.5 5h4v14h-4z",
  sound: "M4 9.5v5h3.5L12 19V5L7.500 9.500zM14.500 8.500a5 5 0 0 1 0 7M17 6a8.500 8.500 0 0 1 0 12",
  muted: "M4 9.5v5h3.5L12 19V5L7.500 9.500zM15 9.500l5 5M20 9.500l-5 5",
  loop: "M5 12V9.500a3 3 0 0 1 3-3h9M14.500 3.500l3 3-3 3M19 12v2.500a3 3 0 0 1-3 3H7M9.500 20.500l-3-3 3-3",
  full: "M4 9V4h5M20 9V4h-5M4 15v5h5M20 15v5h-5",
  download: "M12 4v11M7 10.500l5 5 5-5M4.500 20h15",
  trash: "M4.500 7h15M9.500 7V4.500h5V7M6.500 7l1 13h9l1-13M10 11v5M14 11v5",
  retry: "M19.500 12a7.500 7.500 0 1 1-2.200-5.300M19.500 3.500v4h-4",
  close: "M6 6l12 12M18 6L6 18",
  back: "M14.500 5.500L8 12l6.500 6.500",
  next: "M9.500 5.500L16 12l-6.500 6.500",
  image: "M4 5h16v14H4zM4 16l5-5 4 4 3-3 4 4M15.500 8.800h.01",
  brush: "M20 4c-5 2-9.500 6-11.500 10M8.500 14c-2.500 0-3.500 2-3.500 5.500 3 .5 6-.5 6-3.500M11.500 9.500l3 3",
  check: "M5 12.500l4.500 4.500L19 7.500",
  camera: "M3.500 7.500h11v9h-11zM14.500 11l6-3.500v9l-6-3.500",
  screen: "M3.500 5h17v11.500h-17zM9 20h6M12 16.500V20",
  film: "M4 5h16v14H4zM8 5v14M16 5v14M4 9.700h4M4 14.300h4M16 9.700h4M16 14.300h4",
  record: "M12 6.500a5.500 5.500 0 1 0 0 11a5.500 5.500 0 1 0 0-11",
  stop: "M7 7h10v10H7z",
  mirror: "M12 4v16M9 8l-5.500 8H9zM15 8l5.500 8H15z",
  turn: "M4 9.500a8.500 8.500 0 0 1 15-1M20 4v4.500h-4.500M20 14.500a8.500 8.500 0 0 1-15 1M4 20v-4.500h4.500",
  alert: "M12 4l9 16H3zM12 10v4.500M12 17.200h.01",
};

/** A line icon, hidden from assistive technology: the control that holds it carries the name. */
export function icon(name) {
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("viewBox", "0 0 24 24");
  svg.setAttribute("class", `icon icon-${name}`);
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS(SVG, "path");
  path.setAttribute("d", ICONS[name]);
  svg.append(path);
  return svg;
}

/** A square button with an icon and an accessible name. */
export function iconButton(name, label, onclick, props = {}) {
  return h("button", { type: "button", class: "icon-button", "aria-label": label, title: label, onclick, ...props }, icon(name));
}

/** Give an icon button another icon and name. */
export function relabel(button, name, label) {
  fill(button, icon(name));
  button.setAttribute("aria-label", label);
  button.title = label;
}
