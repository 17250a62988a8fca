/** The dialog that asks for an API key; it is shown only after the service has answered 401. */

import { h } from "./dom.js";

/** Ask until a key is given. `wrong`: one was sent and refused. */
export function askKey(wrong) {
  return new Promise((resolve) => {
    const input = h("input", { type: "password", id: "api-key", autocomplete: "off", required: true, spellcheck: "false" });
    const form = h(
      "form",
      { method: "dialog" },
      h("h2", {}, "An API key, please"),
      h("p", {}, "This service is open to holders of a key only. It is kept for this tab and forgotten with it."),
      h("label", { for: "api-key" }, "API key"),
      input,
      wrong && h("p", { class: "field-error" }, "The service refused that key. Check it and try again."),
      h("button", { class: "button primary", type: "submit" }, "Continue"),
    );
    const dialog = h("dialog", { class: "key", onclose: () => input.value.trim() || dialog.showModal() }, form);
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      dialog.remove();
      resolve(input.value.trim());
    });
    document.body.append(dialog);
    dialog.showModal();
  });
}
