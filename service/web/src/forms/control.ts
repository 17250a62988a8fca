/** What every form control is given. */

import type { FunctionComponent } from "preact";
import type { Field } from "./schema";

/** Element ids that tie label, help and error to the input. */
export interface Ids {
  input: string;
  label: string;
  help: string;
  error: string;
}

export interface ControlProps {
  field: Field;
  ids: Ids;
  value: unknown;
  /** Changes when the value was set from outside: then what the user has typed no longer counts. */
  epoch: number;
  wrong: boolean;
  onChange(value: unknown): void;
  /** What the user typed is no value of the field; `why`: a sentence. */
  onFault(why: string): void;
}

export type Control = FunctionComponent<ControlProps>;

export const described = ({ ids, wrong }: ControlProps) => ({
  "aria-describedby": `${ids.help} ${ids.error}`,
  "aria-invalid": wrong,
});
