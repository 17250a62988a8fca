/** The page's icons and icon buttons for Preact. */

import { ICONS, type IconName } from "./icons";

export function Icon({ name }: { name: IconName }) {
  return (
    <svg viewBox="0 0 24 24" class={`icon icon-${name}`} aria-hidden="true">
      <path d={ICONS[name]} />
    </svg>
  );
}

export interface IconButtonProps {
  name: IconName;
  label: string;
  /** Shown in the tooltip, for example "B". */
  keys?: string;
  pressed?: boolean;
  disabled?: boolean;
  onClick(): void;
}

/** A square button with an icon and an accessible name. */
export function IconButton({ name, label, keys, pressed, disabled, onClick }: IconButtonProps) {
  return (
    <button
      type="button"
      class="icon-button"
      aria-label={label}
      aria-pressed={pressed}
      title={keys ? `${label} (${keys})` : label}
      disabled={disabled ?? false}
      onClick={onClick}
    >
      <Icon name={name} />
    </button>
  );
}
