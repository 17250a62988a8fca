/** A select of all encodings of films: formats with their profiles. */

import { type OutputFormat, outputs } from "../api/formats";
import type { OutputName } from "../api/schemas";

export interface Encoding {
  format: OutputName;
  /** Name of the profile. */
  profile: string;
}

type Profile = OutputFormat["profiles"][number];

/** Encodings in the order of the formats, the usual one of a format first. */
export function encodings(fits: (profile: Profile, format: OutputFormat) => boolean = () => true): Encoding[] {
  return outputs.flatMap((format) =>
    format.profiles
      .filter((profile) => fits(profile, format))
      .map(({ name }) => ({ format: format.name, profile: name })),
  );
}

export const sameEncoding = (one: Encoding, other: Encoding): boolean =>
  one.format === other.format && one.profile === other.profile;

interface EncodingSelectProps {
  label: string;
  value: Encoding;
  offered: readonly Encoding[];
  onchange(value: Encoding): void;
}

export function EncodingSelect({ label, value, offered, onchange }: EncodingSelectProps) {
  return (
    <select
      aria-label={label}
      value={`${value.format} ${value.profile}`}
      onChange={({ currentTarget }) => {
        const chosen = offered.find(({ format, profile }) => `${format} ${profile}` === currentTarget.value);
        if (chosen) onchange(chosen);
      }}
    >
      {outputs
        .filter(({ name }) => offered.some(({ format }) => format === name))
        .map(({ name, title, profiles }) => (
          <optgroup key={name} label={title}>
            {profiles
              .filter((profile) => offered.some((one) => sameEncoding(one, { format: name, profile: profile.name })))
              .map((profile) => (
                <option key={profile.name} value={`${name} ${profile.name}`}>
                  {[profile.title, profile.help].filter(Boolean).join(": ")}
                </option>
              ))}
          </optgroup>
        ))}
    </select>
  );
}
