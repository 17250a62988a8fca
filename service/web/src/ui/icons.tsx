/** Line icons on a grid of 24 x 24. They are hidden from assistive technology: the control that holds one has the name. */

const ICONS = {
  play: "M8 5.5v13l11-6.5z",
  pause: "M7 5h4v14H7zM13.5 5h4v14h-4z",
  sound: "M4 9.5v5h3.5L12 19V5L7.5 9.5zM14.5 8.5a5 5 0 0 1 0 7M17 6a8.5 8.5 0 0 1 0 12",
  muted: "M4 9.5v5h3.5L12 19V5L7.5 9.5zM15 9.5l5 5M20 9.5l-5 5",
  full: "M4 9V4h5M20 9V4h-5M4 15v5h5M20 15v5h-5",
  download: "M12 4v11M7 10.5l5 5 5-5M4.5 20h15",
  upload: "M12 16V5M7 9.500l5-5 5 5M4.5 20h15",
  trash: "M4.5 7h15M9.5 7V4.5h5V7M6.5 7l1 13h9l1-13M10 11v5M14 11v5",
  retry: "M19.5 12a7.5 7.5 0 1 1-2.2-5.3M19.5 3.5v4h-4",
  close: "M6 6l12 12M18 6L6 18",
  back: "M14.5 5.5L8 12l6.5 6.5",
  next: "M9.5 5.5L16 12l-6.5 6.5",
  first: "M6 5v14M18 5.500L9.5 12l8.5 6.5",
  last: "M18 5v14M6 5.500l8.5 6.500L6 18.5",
  previousShot: "M5 5v14M12 5.500L6.500 12l5.500 6.500M19 5.500L13.500 12l5.500 6.500",
  nextShot: "M19 5v14M12 5.500l5.500 6.500-5.500 6.500M5 5.500l5.500 6.500L5 18.500",
  image: "M4 5h16v14H4zM4 16l5-5 4 4 3-3 4 4M15.5 8.8h.01",
  brush: "M20 4c-5 2-9.5 6-11.5 10M8.5 14c-2.5 0-3.5 2-3.5 5.5 3 .5 6-.5 6-3.5M11.5 9.5l3 3",
  eraser: "M9 19h11M5.5 14.500l8.5-8.5 5 5-8 8H9.500l-4-4zM9.5 10.500l5 5",
  smudge:
    "M10 13V5.500a1.500 1.500 0 0 1 3 0V11l4.500 1a2 2 0 0 1 1.500 2.300L18 20h-7l-4.500-6.500a1.300 1.300 0 0 1 2-1.500z",
  fill: "M5 11l7-7 7 7-7 7zM12 4L9.5 1.500M20.5 15c1.5 2 1.5 4 0 4s-1.5-2 0-4zM5 11h14",
  picker: "M4 20l1-4 8.5-8.5 3 3L8 19zM12 6l6 6M15 9l3-3a2.100 2.100 0 0 0-3-3l-3 3",
  pan: "M12 3v18M3 12h18M12 3l-2.5 2.500M12 3l2.5 2.500M12 21l-2.5-2.500M12 21l2.5-2.500M3 12l2.5-2.500M3 12l2.5 2.500M21 12l-2.5-2.500M21 12l-2.5 2.5",
  select: "M5 4l14 6.5-6 2-2.5 6z",
  lasso: "M12 4c5 0 8 2.5 8 5.500S17 15 12 15s-8-2.5-8-5.500S7 4 12 4zM7 14c-1.5 2 .5 3 2 2.500s1 3-2.5 4",
  split: "M12 3v4M12 10v4M12 17v4M8 8l-4 4 4 4M16 8l4 4-4 4",
  arrow: "M4 20L19 5M10 5h9v9",
  undo: "M9 6L4.5 10.5 9 15M5 10.500h9a5 5 0 0 1 0 10h-3",
  redo: "M15 6l4.5 4.500L15 15M19 10.500h-9a5 5 0 0 0 0 10h3",
  plus: "M12 5v14M5 12h14",
  eye: "M2.5 12C5 7.5 8.5 5.5 12 5.500s7 2 9.5 6.500c-2.5 4.5-6 6.5-9.5 6.500S5 16.5 2.5 12zM12 9a3 3 0 1 0 0 6a3 3 0 1 0 0-6",
  hidden: "M4 4l16 16M2.5 12C5 7.5 8.5 5.5 12 5.500s7 2 9.5 6.500c-2.5 4.5-6 6.5-9.5 6.500S5 16.5 2.5 12z",
  key: "M12 3l9 9-9 9-9-9z",
  copy: "M8 8h11v12H8zM5 16V4h11",
  zoom: "M10.5 4a6.5 6.5 0 1 0 0 13a6.5 6.5 0 1 0 0-13M15.5 15.500L20.5 20.500M10.5 7.500v6M7.5 10.500h6",
  zoomOut: "M10.5 4a6.5 6.5 0 1 0 0 13a6.5 6.5 0 1 0 0-13M15.5 15.500L20.5 20.500M7.500 10.500h6",
  check: "M5 12.5l4.5 4.5L19 7.5",
  camera: "M3.5 7.5h11v9h-11zM14.5 11l6-3.5v9l-6-3.5",
  screen: "M3.5 5h17v11.5h-17zM9 20h6M12 16.5V20",
  film: "M4 5h16v14H4zM8 5v14M16 5v14M4 9.7h4M4 14.3h4M16 9.7h4M16 14.3h4",
  record: "M12 6.5a5.5 5.5 0 1 0 0 11a5.5 5.5 0 1 0 0-11",
  mirror: "M12 4v16M9 8l-5.5 8H9zM15 8l5.5 8H15z",
  turn: "M4 9.5a8.5 8.5 0 0 1 15-1M20 4v4.5h-4.5M20 14.5a8.5 8.5 0 0 1-15 1M4 20v-4.5h4.5",
  alert: "M12 4l9 16H3zM12 10v4.5M12 17.2h.01",
} as const;

export type IconName = keyof typeof ICONS;

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
