/** Numbers as people read them. */

import type { AssetInfo } from "../api/schemas";

/** Seconds as a rough length: "8.0 s", "3 min 20 s", "1 h 5 min". */
export function duration(seconds: number): string {
  if (seconds < 10) return `${seconds.toFixed(1)} s`;
  const whole = Math.round(seconds);
  if (whole < 60) return `${whole} s`;
  if (whole < 3600) return `${Math.floor(whole / 60)} min${whole % 60 ? ` ${whole % 60} s` : ""}`;
  return `${Math.floor(whole / 3600)} h ${Math.round((whole % 3600) / 60)} min`;
}

/** Seconds left, without false precision. */
export function remaining(seconds: number): string {
  if (seconds < 5) return "a few seconds left";
  if (seconds < 55) return `about ${Math.ceil(seconds / 5) * 5} seconds left`;
  if (seconds < 90) return "about a minute left";
  if (seconds < 5400) return `about ${Math.round(seconds / 60)} minutes left`;
  return `about ${(seconds / 3600).toFixed(1)} hours left`;
}

/** Position in a film: "0:07.2". */
export function clock(seconds: number): string {
  const tenths = Math.floor((seconds || 0) * 10 + 0.5);
  const rest = ((tenths % 600) / 10).toFixed(1).padStart(4, "0");
  return `${Math.floor(tenths / 600)}:${rest}`;
}

/** Bytes in decimal units. */
export function bytes(count: number): string {
  if (count < 1e6) return `${Math.max(1, Math.round(count / 1e3))} kB`;
  return count < 1e9 ? `${(count / 1e6).toFixed(1)} MB` : `${(count / 1e9).toFixed(2)} GB`;
}

/** How long ago a time (epoch seconds) was. */
export function ago(at: number): string {
  const seconds = Date.now() / 1000 - at;
  if (seconds < 60) return "just now";
  if (seconds < 3600) return `${Math.floor(seconds / 60)} min ago`;
  if (seconds < 86400) return `${Math.floor(seconds / 3600)} h ago`;
  return new Date(at * 1000).toLocaleDateString(undefined, { day: "numeric", month: "short", year: "numeric" });
}

export const percent = (fraction: number): string => `${Math.floor(100 * Math.min(1, Math.max(0, fraction || 0)))} %`;

/** An identifier as a phrase: "line_width_px" -> "Line width px". */
export function humanise(name: string): string {
  const words = name.replace(/[_-]+/g, " ").trim();
  return words.charAt(0).toUpperCase() + words.slice(1);
}

/** An artefact's name as a label: "svg" -> "SVG", "report" -> "Report", "cuts.json" as it is. */
export function artefactTitle(name: string): string {
  if (name.includes(".")) return name;
  return name.length < 5 ? name.toUpperCase() : humanise(name);
}

/** Size, length and rate of an asset, in a line. */
export function describe(info: AssetInfo): string {
  const parts: string[] = [];
  if (info.width) parts.push(`${info.width} × ${info.height}`);
  if (info.duration_s) parts.push(duration(info.duration_s));
  if (info.fps) parts.push(`${Number(info.fps.toFixed(2))} fps`);
  return parts.join(" · ");
}

/** A day in the reader's own notation, from epoch seconds. */
export const day = (at: number): string => new Date(at * 1000).toLocaleDateString();

/** A day and time, from epoch seconds. */
export const moment = (at: number): string => new Date(at * 1000).toLocaleString();
