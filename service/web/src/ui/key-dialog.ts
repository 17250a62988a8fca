/** The dialog that asks for an API key; it is shown only after the service has answered 401. */

import { h } from "./dom";

/** Ask until a key is given. `refused`: one was sent, and the service did not accept it. */
export function askKey(refused: boolean): Promise<string> {
  return new Promise((resolve) => {
    const input = h("input", {
      type: "password",
      id: "api-key",
      autocomplete: "off",
      required: true,
      spellcheck: "false",
    });
    const form = h(
      "form",
      { method: "dialog" },
      h("h2", {}, "API key needed"),
      h(
        "p",
        {},
        "This service accepts requests with an API key only. The key is kept for this tab and forgotten when you close it.",
      ),
      h("label", { for: "api-key" }, "API key"),
      input,
      refused && h("p", { class: "field-error" }, "The service refused that key. Check it and try again."),
      h("button", { class: "button primary", type: "submit" }, "Continue"),
    );
    const dialog = h("dialog", { class: "key" }, form);
    dialog.addEventListener("close", () => input.value.trim() || dialog.showModal());
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      dialog.remove();
      resolve(input.value.trim());
    });
    document.body.append(dialog);
    dialog.showModal();
  });
}
