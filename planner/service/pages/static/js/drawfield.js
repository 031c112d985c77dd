// A field drawn by hand: corners on a grid of metres, dragged or typed, with obstacles; comes out as GeoJSON.
import { el, put, say, button, labelled, note } from "./dom.js";
import { MapView } from "./map.js";
import { colours } from "./palette.js";
import { polygon, line, hatch, word } from "./layers.js";
import { hectares, number } from "./words.js";

const GRAB_PX = 16, FEWEST = 3, DEGREE_M = 111320, ROUND = 10;

export const area = (ring) =>
  Math.abs(ring.reduce((sum, [x, y], k) => { const [u, v] = ring[(k + 1) % ring.length]; return sum + x * v - u * y; }, 0)) / 2;

/** GeoJSON of rings (the first is the outline): local metres, or about a place in degrees where one is given. */
export function fieldGeojson(name, rings, place = null) {
  const around = ([x, y]) => place
    ? [place.lon + x / (DEGREE_M * Math.cos((place.lat * Math.PI) / 180)), place.lat + y / DEGREE_M].map((one) => Number(one.toFixed(8)))
    : [Number(x.toFixed(2)), Number(y.toFixed(2))];
  const ring = (points) => [...points, points[0]].map(around);
  const feature = (points, properties) => ({ type: "Feature", properties, geometry: { type: "Polygon", coordinates: [ring(points)] } });
  return { type: "FeatureCollection", features: rings.map((points, k) => feature(points, k ? { role: "obstacle" } : { name })) };
}

/** The editor; `used(file, local)` with the file that was drawn. */
export function fieldEditor(used) {
  const view = new MapView("Drawing of the field", { short: true });
  let rings = [[]], grabbed = null;
  const words = el("p", { class: "small", role: "status" }), trouble = el("div");
  const name = el("input", { value: "myfield", maxlength: "40" }), x = el("input", { type: "number", step: "any", "aria-label": "Metres east", placeholder: "metres east" }), y = el("input", { type: "number", step: "any", "aria-label": "Metres north", placeholder: "metres north" });
  const place = el("input", { placeholder: "12.345, 51.678", inputmode: "decimal" });
  const current = () => rings[rings.length - 1];
  const add = (point) => { current().push(point.map((one) => Math.round(one * ROUND) / ROUND)); update(); };
  view.node.classList.add("drawing");
  view.clicked = add;
  view.dragged = (phase, at) => {
    if (phase === "start") {
      grabbed = rings.flatMap((ring) => ring.map((corner, k) => ({ ring, k, gap: Math.hypot(corner[0] - at[0], corner[1] - at[1]) * view.scale }))).filter((one) => one.gap < GRAB_PX).sort((a, b) => a.gap - b.gap)[0] ?? null;
      return Boolean(grabbed);
    }
    grabbed.ring[grabbed.k] = at.map((one) => Math.round(one * ROUND) / ROUND);
    update();
    return true;
  };
  view.layers = [grid, (ctx) => {
    polygon(ctx, view, rings, colours.field, colours.edge, 2);
    if (rings.length > 1) hatch(ctx, view, rings.slice(1), colours.soft);
    for (const ring of rings) ring.forEach((corner, k) => {
      const [px, py] = view.at(...corner), next = ring[(k + 1) % ring.length];
      ctx.beginPath(); ctx.arc(px, py, 7, 0, 7); ctx.fillStyle = colours.panel; ctx.fill(); ctx.strokeStyle = colours.accent; ctx.lineWidth = 2.5; ctx.stroke();
      if (ring.length > 1) {
        const [qx, qy] = view.at(...next), length = Math.hypot(next[0] - corner[0], next[1] - corner[1]);
        if (length * view.scale > 60) word(ctx, (px + qx) / 2, (py + qy) / 2, `${number(length, 0)} m`, colours.ink);
      }
    });
  }];
  view.fit([-20, -20, 220, 120]);
  const update = () => {
    const [outline, ...holes] = rings, m2 = area(outline) - holes.reduce((sum, ring) => sum + (ring.length >= FEWEST ? area(ring) : 0), 0);
    say(words, outline.length < FEWEST ? `Tap the corners of the field (${outline.length} so far; a grid line is ${gridStep(view)} m).` : `${outline.length} corners, ${hectares(m2)}${holes.length ? `, ${holes.length} in it` : ""}. Corners can be dragged.`);
    use.disabled = outline.length < FEWEST;
    inside.disabled = current().length < FEWEST;
    undo.disabled = !rings[0].length;
    view.redraw();
  };
  const typed = button("Add corner", () => { if (x.value !== "" && y.value !== "") add([Number(x.value), Number(y.value)]); x.focus(); }, "small");
  const undo = button("Undo", () => { if (!current().length && rings.length > 1) rings.pop(); else current().pop(); update(); }, "small");
  const inside = button("Add an obstacle", () => { rings.push([]); update(); }, "small");
  const use = button("Use this field", () => {
    put(trouble);
    const shapes = rings.filter((ring) => ring.length >= FEWEST), spot = placeOf(place.value);
    if (spot === undefined) return put(trouble, note(`The place is "${place.value}"; give longitude and latitude in degrees, such as 12.345, 51.678, or leave it empty.`, "error"));
    const text = JSON.stringify(fieldGeojson(name.value, shapes, spot));
    used(new File([text], `${name.value.trim() || "myfield"}.geojson`, { type: "application/geo+json" }), !spot, trouble);
  }, "main");
  update();
  const node = el("div", { class: "stack" }, view.node, words, el("div", { class: "row" }, undo, inside),
    el("div", { class: "row" }, el("div", { class: "grow" }, x), el("div", { class: "grow" }, y), typed),
    el("div", { class: "grid" }, labelled("Name", name), labelled("Place of 0, 0", place, "Longitude, latitude; leave empty for local metres.")), trouble, el("div", {}, use));
  return { node, close: () => view.close() };
}

const gridStep = (view) => [1, 5, 10, 50, 100, 500].find((step) => step * view.scale > 24) ?? 1000;

function grid(ctx, view) {
  const step = gridStep(view), [west, north] = view.place(0, 0), [east, south] = view.place(view.width, view.height);
  ctx.strokeStyle = colours.line;
  ctx.globalAlpha = 0.35;
  ctx.lineWidth = 1;
  ctx.beginPath();
  for (let at = Math.ceil(west / step) * step; at < east; at += step) { const [px] = view.at(at, 0); ctx.moveTo(px, 0); ctx.lineTo(px, view.height); }
  for (let at = Math.ceil(south / step) * step; at < north; at += step) { const [, py] = view.at(0, at); ctx.moveTo(0, py); ctx.lineTo(view.width, py); }
  ctx.stroke();
  ctx.globalAlpha = 1;
  line(ctx, view, [[0, south], [0, north]], colours.line, 1);
  line(ctx, view, [[west, 0], [east, 0]], colours.line, 1);
}

// Degrees from text; null if empty, undefined if it is not a number.
function placeOf(text) {
  if (!text.trim()) return null;
  const [lon, lat, more] = text.split(/[,; ]+/).filter(Boolean).map(Number);
  return more === undefined && Math.abs(lon) <= 180 && Math.abs(lat) < 85 ? { lon, lat } : undefined;
}
