// The chosen field of the plan form: its map, area and remarks; entrance, refill place and obstacles are set on it.
import { el, put, say, button, note, facts, sorry } from "./dom.js";
import { placementOf } from "./background.js";
import { fieldSummary } from "./files.js";
import { t } from "./language.js";
import { GROUND, mapLegend } from "./legend.js";
import { MapView } from "./map.js";
import { colours } from "./palette.js";
import { polygon, line, hatch, marker, soil, edge } from "./layers.js";
import { hectares, number } from "./words.js";

const DECIMALS = 7, METRE_DECIMALS = 2, OBSTACLE_M = 1, LEAST_PX = 5;
const PLACES = [["entrance", "Entrance"], ["refill", "Refill place"], ["obstacle", "Obstacle"]];

/** Places of a text such as "12.3,51.6; 12.4,51.7,2" as lists of numbers; words that are none are left out. */
export const placesOf = (text) => text.split(/[;\s]+/).map((one) => one.split(",").map(Number)).filter((one) => one.length > 1 && one.every(Number.isFinite));

/** The map; `picked(name, text)` when a place was set on it: entrance, refill or obstacle, in the coordinates of the file. */
export function fieldMap(picked) {
  const view = new MapView("Map of the chosen field", { short: true }), under = el("div", { class: "under" }), told = el("p", { class: "small", role: "status" });
  let shape = null, placement = null, asked = 0, setting = null, texts = {};
  const into = ([a, b]) => (placement ? placement.fromDegrees(a, b) : [a, b]);
  const out = ([x, y]) => (placement ? placement.toDegrees(x, y).map((one) => one.toFixed(DECIMALS)) : [x, y].map((one) => one.toFixed(METRE_DECIMALS)));
  const canPlace = () => shape && (placement || (!shape.crs && shape.origin_m));
  const choices = PLACES.map(([name, words]) => [name, button(words, () => { setting = setting === name ? null : name; showChoice(); }, "small")]);
  const clear = button("Clear", () => { for (const [name] of PLACES) set(name, ""); say(told, ""); }, "small");
  const row = el("div", { class: "row", role: "group", "aria-label": "Set on the map", hidden: true }, el("span", { class: "small soft" }, "Set on the map:"), choices.map(([, action]) => action), clear);
  const draw = () => { if (shape) put(legend, mapLegend(entries())); view.redraw(); };
  const set = (name, text) => { picked(name, text); box.setPlace(name, text); };
  const showChoice = () => {
    for (const [name, action] of choices) action.setAttribute("aria-pressed", String(setting === name));
    view.node.classList.toggle("drawing", Boolean(setting));
    view.clicked = setting ? place : null;
    if (setting) say(told, t`Tap the place on the map.`);
  };
  const place = (at) => {
    const text = out(at).join(","), words = PLACES.find(([name]) => name === setting)[1];
    if (setting === "obstacle") set(setting, [texts.obstacle, `${text},${OBSTACLE_M}`].filter(Boolean).join("; "));
    else { set(setting, text); setting = null; showChoice(); }
    say(told, `${words}: ${text}`);
  };
  const placesIn = (name) => (canPlace() ? placesOf(texts[name] ?? "") : []);
  view.layers = [(ctx) => {
    if (!shape) return;
    soil(ctx, view, shape.rings_m);
    edge(ctx, view, shape.rings_m, 2);
    for (const ring of shape.obstacles_m ?? []) polygon(ctx, view, [ring], colours.obstacle);
    if (shape.obstacles_m?.length) hatch(ctx, view, shape.obstacles_m, colours.ink);
    for (const fence of shape.fences_m ?? []) line(ctx, view, fence, colours.ink, 3, [6, 3]);
    const [[entrance], [refill]] = [placesIn("entrance"), placesIn("refill")];
    if (entrance) marker(ctx, view, into(entrance), "entrance"); else if (shape.entrance_m) marker(ctx, view, shape.entrance_m, "");
    if (refill) marker(ctx, view, into(refill), "refill", true); else if (shape.refill_m) marker(ctx, view, shape.refill_m, "refill", true);
    for (const one of placesIn("obstacle")) {
      const [px, py] = view.at(...into(one));
      ctx.beginPath();
      ctx.arc(px, py, Math.max(LEAST_PX, (one[2] ?? OBSTACLE_M) * view.scale), 0, 7);
      ctx.fillStyle = colours.obstacle;
      ctx.fill();
      ctx.lineWidth = 2;
      ctx.strokeStyle = colours.off;
      ctx.stroke();
    }
  }];
  const entries = () => [GROUND.edge, shape.obstacles_m?.length > 0 && GROUND.obstacle, shape.fences_m?.length > 0 && GROUND.fence,
    (shape.entrance_m || placesIn("entrance").length) && GROUND.entrance, (shape.refill_m || placesIn("refill").length) && GROUND.refill,
    placesIn("obstacle").length && [{ ring: "off" }, "obstacle added here"]];
  const legend = el("div");
  const tell = () => put(under, row, told, facts([["Area", hectares(1e4 * shape.area_ha)], ["Corners", number(shape.rings_m[0].length - 1)], ["Obstacles", number((shape.obstacles_m ?? []).length)]]),
    legend,
    (shape.remarks ?? []).map((one) => el("p", { class: "small soft" }, one)));
  const locate = async (box, mine) => {
    const found = shape.crs ? await placementOf(shape.crs, shape.origin_m, [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2]) : null;
    if (mine !== asked) return;
    placement = found;
    row.hidden = !canPlace();
    view.setGrounds([{ crs: shape.crs, origin: shape.origin_m ?? [0, 0], box }]);
    draw();
  };
  const box = { node: el("div", { class: "panel flush" }, view.node, under), close: () => view.close(), update: () => {}, refused: () => {} };

  /** The field that is shown, as the reader has it; null while there is none. */
  box.field = () => shape;

  /** Longitude and latitude of the middle of the field; null without a place on the earth. */
  box.middle = () => placement && placement.toDegrees(view.box[0] / 2 + view.box[2] / 2, view.box[1] / 2 + view.box[3] / 2);

  /** Places typed into the form are drawn too. */
  box.setPlace = (name, text) => { texts = { ...texts, [name]: text }; draw(); };

  box.show = async (name, how) => {
    if (!name) return;
    const mine = ++asked;
    shape = placement = null;
    try {
      const summary = await fieldSummary(name, how);
      if (mine !== asked) return;
      shape = summary.field;
      box.update(summary);
      if (!shape) return put(under, note(summary.fields?.length > 1 ? t`The file holds ${summary.fields.length} fields; choose one of them.` : summary.error, "warn"));
      const points = shape.rings_m.flat(), around = [0, 1].map((k) => Math.min(...points.map((p) => p[k]))).concat([0, 1].map((k) => Math.max(...points.map((p) => p[k]))));
      view.fit(around);
      tell();
      await locate(around, mine);
    } catch (error) {
      if (mine !== asked) return;
      put(under, sorry(error));
      box.refused(error);
    } finally {
      view.redraw();
    }
  };
  return box;
}
