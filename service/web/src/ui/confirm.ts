/** Buttons that act on the service: at once, or after a dialog that says what will happen and may ask for the reason. */

import { h, unique } from "./dom";
import { notify } from "./notices";

export interface ActionButton {
  label: string;
  /** May throw a Problem, which is shown. `reason`: what the user wrote, perhaps empty. */
  act(reason: string): unknown;
  /** Called after the action, whether it succeeded or not. */
  done(): void;
}

export interface Confirmation {
  title: string;
  text: string;
  /** Ask for a reason, for other operators to read. */
  why?: boolean;
  danger?: boolean;
}

/** A small button that acts after a dialog. */
export function confirmButton(options: ActionButton & Confirmation): HTMLButtonElement {
  const { label, danger } = options;
  return actionButton(options, `button small ${danger ? "danger" : ""}`, () => ask({ ...options, verb: label }));
}

/** A small button that acts at once, since nothing is lost by it. */
export function plainButton(options: ActionButton): HTMLButtonElement {
  return actionButton(options, "button small", () => Promise.resolve(""));
}

function actionButton(
  { label, act, done }: ActionButton,
  style: string,
  reasonOf: () => Promise<string | null>,
): HTMLButtonElement {
  const onclick = async () => {
    const reason = await reasonOf();
    if (reason === null) return;
    button.disabled = true;
    await Promise.resolve(act(reason)).catch(notify);
    button.disabled = false;
    done();
  };
  const button = h("button", { type: "button", class: style, onclick }, label);
  return button;
}

/** The reason (perhaps empty), or null if the user decided against it. */
function ask({ title, text, verb, why, danger }: Confirmation & { verb: string }): Promise<string | null> {
  return new Promise((resolve) => {
    const id = unique("why");
    const input = why ? h("input", { type: "text", id, maxLength: 300, autocomplete: "off" }) : null;
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
    const dialog = h("dialog", { class: "key confirm-dialog" }, form);
    dialog.addEventListener("close", () => {
      dialog.remove();
      resolve(dialog.returnValue === "yes" ? (input?.value.trim() ?? "") : null);
    });
    document.body.append(dialog);
    dialog.showModal();
  });
}
