// Figures as text, in the units of the reader; an unknown value is a dash.
import { languageInUse, plural, t, translate } from "./language.js";
import { inUnits } from "./units.js";

export { plural };

export const DASH = "\u2013";
const known = (value) => typeof value === "number" && Number.isFinite(value);
const two = (value) => String(value).padStart(2, "0");

/** A metric value with its unit; feet and acres where the reader wants them. */
export function number(value, decimals = 0, unit = "") {
  if (!known(value)) return DASH;
  const [shown, name] = inUnits(value, unit);
  return `${shown.toFixed(decimals)}${name ? "\u00A0" + name : ""}`;
}

/** Seconds as 1:02:03. */
export function clock(seconds) {
  if (!known(seconds)) return DASH;
  const whole = Math.round(Math.abs(seconds));
  const text = `${Math.floor(whole / 3600)}:${two(Math.floor(whole / 60) % 60)}:${two(whole % 60)}`;
  return seconds < -0.5 ? `-${text}` : text;
}

/** The time of day by which something is done, so many seconds after a start such as 13:00; without a start as 1:02:03. */
export function doneBy(start, seconds) {
  const [, hours, minutes] = /^(\d{1,2}):(\d{2})/.exec(start ?? "") ?? [];
  if (!known(seconds) || hours === undefined) return clock(seconds);
  const end = 60 * Number(hours) + Number(minutes) + Math.ceil(Math.round(1000 * seconds) / 60000), days = Math.floor(end / 1440);
  return `${two(Math.floor(end / 60) % 24)}:${two(end % 60)}${days ? `+${days}` : ""}`;
}

/** A cost as it is stated: with two decimals, or none from 10 on. */
export const money = (value, currency = "") =>
  known(value) ? `${value.toFixed(Math.abs(value) < 9.995 ? 2 : 0)}${currency ? "\u00A0" + currency : ""}` : DASH;

/** A probability in percent, rounded neither to 0 nor to 100. */
export const chance = (share) =>
  !known(share) ? DASH : share >= 0.995 && share < 1 ? ">99" : share > 0 && share < 0.005 ? "<1" : (100 * share).toFixed(0);

/** Seconds as a length of time in words: 45 s, 12 min, 1 h 05 min. */
export function span(seconds) {
  if (!known(seconds)) return DASH;
  const whole = Math.round(Math.abs(seconds));
  if (whole < 60) return `${whole}\u00A0s`;
  if (whole < 3600) return `${Math.round(whole / 60)}\u00A0min`;
  const minutes = Math.round(whole / 60);
  return `${Math.floor(minutes / 60)}\u00A0h\u00A0${two(minutes % 60)}\u00A0min`;
}

/** The age of a fix. */
export const age = (seconds) =>
  !known(seconds) ? translate("no fix yet") : seconds < 1 ? `${seconds.toFixed(1)}\u00A0s` : `${span(seconds)}`;

/** Time of day so many seconds from now, or of a moment as the service writes it (ISO 8601 or seconds of UTC). */
export function timeOfDay(seconds, from = Date.now()) {
  if (!known(seconds)) return DASH;
  const at = new Date(from + 1000 * seconds);
  return `${two(at.getHours())}:${two(at.getMinutes())}`;
}

export function moment(value) {
  const at = typeof value === "number" ? new Date(value * 1000) : new Date(value);
  if (value === null || value === undefined || Number.isNaN(at.getTime())) return DASH;
  const day = at.toDateString() === new Date().toDateString() ? "" : `${at.toLocaleDateString(languageInUse() === "en" ? undefined : languageInUse())} `;
  return `${day}${two(at.getHours())}:${two(at.getMinutes())}:${two(at.getSeconds())}`;
}

export const hectares = (m2) => (known(m2) ? number(m2 / 10000, 2, "ha") : DASH);
export const inCm = (metres) => number(100 * metres, 0, "cm");
export const kmh = (mps) => (known(mps) ? number(mps * 3.6, 1, "km/h") : DASH);
/** A share in percent; less than all is never rounded up to 100 %. */
export function percent(value) {
  if (!known(value)) return DASH;
  const fine = value < 10 || (value > 99 && value < 100);
  return `${(value < 100 && fine ? Math.min(value, 99.9) : value).toFixed(fine ? 1 : 0)}\u00A0%`;
}
export const size = (bytes) =>
  !known(bytes) ? DASH : bytes < 1e6 ? `${Math.max(1, Math.round(bytes / 1e3))}\u00A0kB` : `${(bytes / 1e6).toFixed(1)}\u00A0MB`;
export const capital = (text) => text.slice(0, 1).toUpperCase() + text.slice(1);

/** How the badge of a fleet looks, by its state. */
export const LOOKS = { running: "good", stopped: "off" };

const LEGS = {
  track: (n) => t`track ${n}`, round: (n) => t`headland pass ${n}`, turn: (n) => t`turning to track ${n}`,
  enter: () => translate("coming in"), leave: () => translate("going out"), "drive-in": (n) => t`lining up for track ${n}`,
};
/** A leg of a plan in words; tracks count from 0, headland passes from 1. */
export function legWords(leg) {
  if (!leg) return DASH;
  const number = known(leg.number) ? leg.number + (leg.kind === "round" ? 0 : 1) : "";
  return LEGS[leg.kind] ? LEGS[leg.kind](number).trim() : String(leg.kind || "driving").replaceAll("-", " ");
}
