/** Line icons on a grid of 24 x 24. They are hidden from assistive technology: the control that holds one has the name. */

const ICONS = {
  play: "M8 5.5v13l11-6.5z",
  pause: "M7 5h4v14H7zM13.5 5h4v14h-4z",
  sound: "M4 9.5v5h3.5L12 19V5L7.5 9.5zM14.5 8.5a5 5 0 0 1 0 7M17 6a8.5 8.5 0 0 1 0 12",
  broadcast:
    "M12 10.5a1.5 1.5 0 1 0 0 3a1.5 1.5 0 0 0 0-3zM8.5 8.5a5 5 0 0 0 0 7M15.5 8.5a5 5 0 0 1 0 7M5.8 5.8a8.8 8.8 0 0 0 0 12.4M18.2 5.8a8.8 8.8 0 0 1 0 12.4",
  muted: "M4 9.5v5h3.5L12 19V5L7.5 9.5zM15 9.5l5 5M20 9.5l-5 5",
  full: "M4 9V4h5M20 9V4h-5M4 15v5h5M20 15v5h-5",
  download: "M12 4v11M7 10.5l5 5 5-5M4.5 20h15",
  upload: "M12 16V5M7 9.5l5-5 5 5M4.5 20h15",
  trash: "M4.5 7h15M9.5 7V4.5h5V7M6.5 7l1 13h9l1-13M10 11v5M14 11v5",
  retry: "M19.5 12a7.5 7.5 0 1 1-2.2-5.3M19.5 3.5v4h-4",
  close: "M6 6l12 12M18 6L6 18",
  back: "M14.5 5.5L8 12l6.5 6.5",
  next: "M9.5 5.5L16 12l-6.5 6.5",
  first: "M6 5v14M18 5.5L9.5 12l8.5 6.5",
  last: "M18 5v14M6 5.5l8.5 6.5L6 18.5",
  previousCut: "M5 5v14M12 5.5L6.5 12l5.5 6.5M19 5.5L13.5 12l5.5 6.5",
  nextCut: "M19 5v14M12 5.5l5.5 6.5-5.5 6.5M5 5.5l5.5 6.5L5 18.5",
  flag: "M6 21V4M6 4h12l-3 4 3 4H6",
  keys: "M3 6h18v12H3zM6.5 10h.01M10 10h.01M13.5 10h.01M17 10h.01M8 14h8",
  panel: "M3.5 5h17v14h-17zM14.5 5v14",
  loop: "M4 11a6 6 0 0 1 6-6h8M15 2l3 3-3 3M20 13a6 6 0 0 1-6 6H6M9 22l-3-3 3-3",
  comment: "M4 5h16v11H11l-4.5 4v-4H4zM8 9h8M8 12h5",
  rangeStart: "M15 5H9v14h6",
  rangeEnd: "M9 5h6v14H9",
  trim: "M8 4H5v16h3M16 4h3v16h-3M9 12h6M11 10l-2 2 2 2M13 10l2 2-2 2",
  cut: "M7 5a2.5 2.5 0 1 0 0 5a2.5 2.5 0 1 0 0-5M7 14a2.5 2.5 0 1 0 0 5a2.5 2.5 0 1 0 0-5M9 9l11 8M9 15l11-8",
  image: "M4 5h16v14H4zM4 16l5-5 4 4 3-3 4 4M15.5 8.8h.01",
  brush: "M20 4c-5 2-9.5 6-11.5 10M8.5 14c-2.5 0-3.5 2-3.5 5.5 3 .5 6-.5 6-3.5M11.5 9.5l3 3",
  eraser: "M9 19h11M5.5 14.5l8.5-8.5 5 5-8 8H9.5l-4-4zM9.5 10.5l5 5",
  smudge: "M10 13V5.5a1.5 1.5 0 0 1 3 0V11l4.5 1a2 2 0 0 1 1.5 2.3L18 20h-7l-4.5-6.5a1.3 1.3 0 0 1 2-1.5z",
  fill: "M5 11l7-7 7 7-7 7zM12 4L9.5 1.5M20.5 15c1.5 2 1.5 4 0 4s-1.5-2 0-4zM5 11h14",
  picker: "M4 20l1-4 8.5-8.5 3 3L8 19zM12 6l6 6M15 9l3-3a2.1 2.1 0 0 0-3-3l-3 3",
  pan: "M12 3v18M3 12h18M12 3l-2.5 2.5M12 3l2.5 2.5M12 21l-2.5-2.5M12 21l2.5-2.5M3 12l2.5-2.5M3 12l2.5 2.5M21 12l-2.5-2.5M21 12l-2.5 2.5",
  select: "M5 4l14 6.5-6 2-2.5 6z",
  lasso: "M12 4c5 0 8 2.5 8 5.5S17 15 12 15s-8-2.5-8-5.5S7 4 12 4zM7 14c-1.5 2 .5 3 2 2.5s1 3-2.5 4",
  transform: "M6 6h12v12H6zM4.5 4.5h3v3h-3zM16.5 4.5h3v3h-3zM4.5 16.5h3v3h-3zM16.5 16.5h3v3h-3z",
  frame: "M5 8V5h3M11 5h2M16 5h3v3M19 11v2M19 16v3h-3M13 19h-2M8 19H5v-3M5 13v-2",
  object: "M12 4a8 8 0 1 0 0 16a8 8 0 1 0 0-16M12 1.5V8M12 16v6.5M1.5 12H8M16 12h6.5",
  matte: "M12 4a8 8 0 1 0 0 16a8 8 0 1 0 0-16M12 4v16M12 8h6.5M12 12h8M12 16h6.5",
  matteBrush:
    "M20 4c-5 2-9.5 6-11.5 10M8.5 14c-2.5 0-3.5 2-3.5 5.5 3 .5 6-.5 6-3.5M11.5 9.5l3 3M5 2.5a2.5 2.5 0 1 0 0 5a2.5 2.5 0 1 0 0-5M5 2.5v5",
  matteEraser:
    "M9 19h11M5.5 14.5l8.5-8.5 5 5-8 8H9.5l-4-4zM9.5 10.5l5 5M5 2.5a2.5 2.5 0 1 0 0 5a2.5 2.5 0 1 0 0-5M5 2.5v5",
  split: "M12 3v4M12 10v4M12 17v4M8 8l-4 4 4 4M16 8l4 4-4 4",
  arrow: "M4 20L19 5M10 5h9v9",
  undo: "M9 6L4.5 10.5 9 15M5 10.5h9a5 5 0 0 1 0 10h-3",
  redo: "M15 6l4.5 4.5L15 15M19 10.5h-9a5 5 0 0 0 0 10h3",
  plus: "M12 5v14M5 12h14",
  eye: "M2.5 12C5 7.5 8.5 5.5 12 5.5s7 2 9.5 6.5c-2.5 4.5-6 6.5-9.5 6.5S5 16.5 2.5 12zM12 9a3 3 0 1 0 0 6a3 3 0 1 0 0-6",
  hidden: "M4 4l16 16M2.5 12C5 7.5 8.5 5.5 12 5.5s7 2 9.5 6.5c-2.5 4.5-6 6.5-9.5 6.5S5 16.5 2.5 12z",
  key: "M12 3l9 9-9 9-9-9z",
  copy: "M8 8h11v12H8zM5 16V4h11",
  zoom: "M10.5 4a6.5 6.5 0 1 0 0 13a6.5 6.5 0 1 0 0-13M15.5 15.5L20.5 20.5M10.5 7.5v6M7.5 10.5h6",
  zoomOut: "M10.5 4a6.5 6.5 0 1 0 0 13a6.5 6.5 0 1 0 0-13M15.5 15.5L20.5 20.5M7.5 10.5h6",
  check: "M5 12.5l4.5 4.5L19 7.5",
  camera: "M3.5 7.5h11v9h-11zM14.5 11l6-3.5v9l-6-3.5",
  screen: "M3.5 5h17v11.5h-17zM9 20h6M12 16.5V20",
  film: "M4 5h16v14H4zM8 5v14M16 5v14M4 9.7h4M4 14.3h4M16 9.7h4M16 14.3h4",
  record: "M12 6.5a5.5 5.5 0 1 0 0 11a5.5 5.5 0 1 0 0-11",
  swap: "M7 4v13M7 4L4 7M7 4l3 3M17 20V7M17 20l-3-3M17 20l3-3",
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
