// Draws the operations of /openapi.json. Text goes in as text, never as HTML.
const VERBS = ["get", "head", "post", "patch", "put", "delete", "options"];

function element(tag, text = "", className = "", ...children) {
  const made = document.createElement(tag);
  made.textContent = text;
  if (className) made.className = className;
  made.append(...children);
  return made;
}

function table(heads, rows) {
  const head = element("tr", "", "", ...heads.map((text) => element("th", text)));
  const body = rows.map((row) => element("tr", "", "", ...row.map((text) => element("td", text))));
  return element("table", "", "", head, ...body);
}

const nameOf = (schema) => schema?.$ref?.split("/").at(-1);

// A schema with its references put in, each once on the way down.
function whole(schema, schemas, seen = []) {
  if (Array.isArray(schema)) return schema.map((item) => whole(item, schemas, seen));
  if (schema === null || typeof schema !== "object") return schema;
  const name = nameOf(schema);
  if (name) return seen.includes(name) ? { $ref: name } : whole(schemas[name], schemas, [...seen, name]);
  return Object.fromEntries(Object.entries(schema).map(([key, value]) => [key, whole(value, schemas, seen)]));
}

function bodies(content, schemas) {
  return Object.entries(content ?? {}).map(([type, { schema }]) =>
    element("details", "", "", element("summary", type), element("pre", JSON.stringify(whole(schema, schemas), null, 2))),
  );
}

function typeOf(schema = {}) {
  const kinds = schema.anyOf ?? [schema];
  return kinds.map((kind) => kind.enum?.join(" | ") ?? kind.type ?? nameOf(kind) ?? "").join(" | ");
}

function operation(verb, path, found, schemas) {
  const title = element("summary", "", "", element("span", verb.toUpperCase(), "verb"), element("code", path), element("span", found.summary ?? "", "text"));
  const box = element("details", "", "", title);
  box.id = found.operationId;
  if (found.description) box.append(element("p", found.description));
  if (found.parameters?.length) {
    const rows = found.parameters.map((one) => [one.name, one.in, typeOf(one.schema), one.required ? "yes" : "", one.description ?? ""]);
    box.append(table(["name", "in", "type", "required", ""], rows));
  }
  if (found.requestBody) box.append(element("h4", "Body"), ...bodies(found.requestBody.content, schemas));
  box.append(element("h4", "Answers"));
  for (const [status, answer] of Object.entries(found.responses)) {
    box.append(element("p", `${status}  ${answer.description ?? ""}`), ...bodies(answer.content, schemas));
  }
  return box;
}

function draw(api) {
  document.getElementById("summary").textContent = api.info.summary ?? "";
  const groups = new Map();
  for (const [path, item] of Object.entries(api.paths)) {
    for (const verb of VERBS.filter((one) => item[one])) {
      const tag = item[verb].tags?.[0] ?? "other";
      groups.set(tag, [...(groups.get(tag) ?? []), operation(verb, path, item[verb], api.components.schemas)]);
    }
  }
  const sections = [...groups].map(([tag, boxes]) => element("section", "", "", element("h2", tag), ...boxes));
  document.getElementById("operations").replaceChildren(...sections);
}

draw(await (await fetch(new URL("../openapi.json", import.meta.url))).json());
