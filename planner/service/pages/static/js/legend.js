// What the lines, areas and signs of a map mean, each drawn as the map draws it.
import { el } from "./dom.js";
import { t } from "./language.js";
import { number } from "./words.js";

const SVG = "http://www.w3.org/2000/svg", WIDE = 30, HIGH = 14;

function shape(name, attributes, look = {}) {
  const node = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, String(value));
  for (const [key, value] of Object.entries(look)) node.style.setProperty(key, value);
  return node;
}

const stroke = (colour, width, dash = "", opacity = 1) =>
  shape("line", { x1: 1, y1: HIGH / 2, x2: WIDE - 1, y2: HIGH / 2, "stroke-width": width, "stroke-dasharray": dash, opacity }, { stroke: `var(--${colour})` });

const SIGNS = {
  line: ({ colour, width = 2, dash = "", opacity = 1 }) => [stroke(colour, width, dash, opacity)],
  area: ({ colour, opacity = 1, rim = null }) => [shape("rect", { x: 2, y: 1, width: WIDE - 4, height: HIGH - 2, opacity }, { fill: `var(--${colour})`, ...(rim ? { stroke: `var(--${rim})` } : {}) })],
  hatch: ({ colour, back = null }) => [...(back ? SIGNS.area({ colour: back }) : []), ...[0, 7, 14, 21].map((x) => shape("line", { x1: x + 2, y1: 1, x2: x + 9, y2: HIGH - 1, "stroke-width": 1 }, { stroke: `var(--${colour})` }))],
  diamond: ({ colour }) => [shape("path", { d: `M${WIDE / 2} 0l6 ${HIGH / 2}-6 ${HIGH / 2}-6-${HIGH / 2}z` }, { fill: `var(--${colour})` })],
  disc: ({ colour }) => [shape("circle", { cx: WIDE / 2, cy: HIGH / 2, r: 6, "stroke-width": 2 }, { stroke: "var(--ink)", fill: `var(--${colour})` })],
  place: ({ colour }) => [shape("path", { d: `M${WIDE / 2} ${HIGH - 1}l-5-11h10z` }, { fill: `var(--${colour})` })],
  ring: ({ colour, dash = "" }) => [shape("circle", { cx: WIDE / 2, cy: HIGH / 2, r: 5, "stroke-width": 2, "stroke-dasharray": dash }, { stroke: `var(--${colour})`, fill: "none" })],
};

/** A legend of entries [sign, words]: sign is {line | area | hatch | place | diamond | disc | ring: colour, width, dash}; null is left out. */
export function mapLegend(entries) {
  return el("ul", { class: "legend", "aria-label": "Legend" }, entries.filter(Boolean).map(([sign, words]) => {
    const kind = Object.keys(SIGNS).find((name) => name in sign), picture = shape("svg", { viewBox: `0 0 ${WIDE} ${HIGH}`, width: WIDE, height: HIGH, "aria-hidden": "true", class: "swatch" });
    picture.append(...SIGNS[kind]({ ...sign, colour: sign[kind] }));
    return el("li", {}, picture, words);
  }));
}

/** The ground, as most maps draw it. */
export const GROUND = {
  edge: [{ line: "edge", width: 1.5 }, "edge of the field"],
  obstacle: [{ hatch: "ink", back: "obstacle" }, "obstacle"],
  fence: [{ line: "ink", width: 3, dash: "6 3" }, "dashed, thick: fence"],
  pole: [{ disc: "obstacle" }, "obstacle: a point, as wide as it is"],
  entrance: [{ place: "ink" }, "entrance"],
  refill: [{ diamond: "ink" }, "refill place"],
  guidance: [{ line: "t4", width: 2, dash: "10 4 2 4" }, "dash and dot: guidance line"],
};

/** The entries of a plan as it has them. */
export const planEntries = (plan) => [
  GROUND.edge,
  [{ line: "swath", width: 1.5 }, "track, with its number"],
  [{ area: "t0", opacity: 0.4 }, "worked so far, in the tractor's colour"],
  [{ line: "t0", width: 1.8, opacity: 0.8 }, "path while working"],
  [{ line: "t0", width: 1, opacity: 0.8 }, "thin: turning and driving"],
  plan.lanes.some((lane) => lane.status.includes(4)) && [{ line: "t0", width: 1.4, dash: "2 3" }, "dotted: reversing"],
  plan.missed_m.length > 0 && [{ hatch: "off" }, "left unworked"],
  plan.relief && [{ line: "soft", width: 1, opacity: 0.7 }, t`contours every ${number(plan.relief.interval_m, plan.relief.interval_m < 1 ? 1 : 0, "m")}`],
  plan.obstacles_m.length > 0 && [{ area: "obstacle" }, "obstacle"],
  plan.fences_m.length > 0 && GROUND.fence,
  plan.entrance_m && GROUND.entrance,
];

/** The entries of a recorded run. */
export const RECORDED = [
  [{ line: "t0", width: 2.2 }, "driven so far"],
  [{ line: "t0", width: 1.2, opacity: 0.35 }, "thin: the whole run"],
];

/** The entries of live fleets. */
export const LIVE = [
  [{ area: "t0", opacity: 0.42 }, "worked"],
  [{ line: "t0", width: 4 }, "thick: may be driven now"],
  [{ line: "t0", width: 1.3, opacity: 0.6 }, "thin: planned work"],
  [{ line: "t0", width: 1, dash: "3 3", opacity: 0.7 }, "thin, dashed: planned turns and ways"],
  [{ line: "warn", width: 2, dash: "2 5" }, "dotted between tractors: waits for"],
  [{ line: "line", width: 1, dash: "2 6" }, "dotted round the field: geofence"],
  [{ ring: "ink", dash: "4 3" }, "dashed outline: twin, or last known place"],
  [{ ring: "off", dash: "4 3" }, "dashed circle that grows: where a tractor in doubt may be"],
];
