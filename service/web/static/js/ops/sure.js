/** Nothing is stopped by a slip: a dialog says what will happen, and may ask why. */

import { h, unique } from "../dom.js";
import { notify } from "../notices.js";

/** A small button that acts after a dialog. `act(reason)` may throw a Problem; `done` follows in any case. */
export function sureButton({ label, title, text, why = false, danger = false, act, done }) {
  const onclick = async (event) => {
    const button = event.currentTarget;
    const reason = await ask({ title, text, verb: label, why, danger });
    if (reason === null) return;
    button.disabled = true;
    await Promise.resolve(act(reason)).catch(notify);
    button.disabled = false;
    done();
  };
  return h("button", { type: "button", class: `button small ${danger ? "danger" : ""}`, onclick }, label);
}

/** A small button that acts at once: what it does harms nothing. */
export function plainButton({ label, act, done }) {
  const onclick = async (event) => {
    const button = event.currentTarget;
    button.disabled = true;
    await Promise.resolve(act()).catch(notify);
    button.disabled = false;
    done();
  };
  return h("button", { type: "button", class: "button small", onclick }, label);
}

/** The reason (perhaps empty), or null if it is not to be done. */
function ask({ title, text, verb, why, danger }) {
  return new Promise((resolve) => {
    const id = unique("why");
    const input = why && h("input", { type: "text", id, maxLength: 300, autocomplete: "off" });
    const form = h(
      "form",
      { method: "dialog" },
      h("h2", {}, title),
      h("p", {}, text),
      why && h("label", { for: id }, "Why (for the other operators)"),
      input,
      h(
        "div",
        { class: "actions" },
        h("button", { class: `button ${danger ? "danger" : "primary"}`, value: "yes" }, verb),
        h("button", { class: "button", value: "no", formNoValidate: true }, "Leave it"),
      ),
    );
    const dialog = h("dialog", { class: "key sure-dialog" }, form);
    dialog.addEventListener("close", () => {
      dialog.remove();
      resolve(dialog.returnValue === "yes" ? (input ? input.value.trim() : "") : null);
    });
    document.body.append(dialog);
    dialog.showModal();
  });
}
