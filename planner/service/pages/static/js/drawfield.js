// The editor of a field: its boundary, holes, obstacles, entrance, refill place, fences and guidance lines, by pointer or keys.
import { el, put, say, button, labelled, note, option } from "./dom.js";
import { t, translate } from "./language.js";
import { backgroundOf, placementAt, placementOf } from "./background.js";
import { Drawing, KINDS, geojsonOf, shapesOf, sizeOf } from "./shapes.js";
import { shapeLayer, grid, gridStep, handleAt, drawnEntries } from "./drawlayers.js";
import { MapView } from "./map.js";
import { mapLegend } from "./legend.js";
import { hectares, number } from "./words.js";

export { area } from "./shapes.js";

const ROUND = 100, EDGE_PX = 24, OFFERED = ["boundary", "hole", "pole", "area", "ditch", "entrance", "refill", "fence", "guidance"];
const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

/** The editor. `saved(file, {name, local, replace}, where)` with what was drawn; `where` takes a refusal.

`field` is the summary of a field to be changed, `name` the file it is of, `mayReplace` whether that can be replaced. */
export function fieldEditor(saved, { field = null, name: fileName = "myfield", mayReplace = false, near = () => null } = {}) {
  const view = new MapView("Drawing of the field", { keys: "Shift with arrow keys moves the chosen point by a metre, Delete removes it." });
  let drawing = new Drawing(), placement = null, origin = [0, 0], marked = false, ready = !field;
  const words = el("p", { class: "small", role: "status" }), trouble = el("div"), legend = el("div");
  const kind = el("select", { "aria-label": "What to draw", onchange: () => { drawing.at = { shape: drawing.shapes.findIndex((one) => one.kind === kind.value && KINDS[one.kind].one), point: -1 }; update(); } }, OFFERED.map((one) => option(one, KINDS[one].words)));
  const points = el("select", { "aria-label": "Chosen point", onchange: () => { const [shape, point] = points.value.split(" ").map(Number); choose({ shape, point }, true); } });
  const x = el("input", { type: "number", step: "any", "aria-label": "Metres east", placeholder: "metres east" }), y = el("input", { type: "number", step: "any", "aria-label": "Metres north", placeholder: "metres north" });
  const degrees = el("input", { type: "checkbox", onchange: () => { nameAxes(); tellPoint(); } }), inDegrees = el("label", { class: "check", hidden: true }, degrees, "Type longitude and latitude");
  const name = el("input", { value: fileName, maxlength: "80" }), place = el("input", { placeholder: "12.345, 51.678", inputmode: "decimal", onchange: () => goTo(place.value) });
  const size = el("input", { type: "number", step: "any", min: "0" }), sizeLabel = labelled("Radius, m", size), title = el("input", { maxlength: "60" }), titleLabel = labelled("Its name", title);
  const rounded = (point) => point.map((one) => Math.round(one * ROUND) / ROUND);

  const choose = (at, follow = false) => {
    drawing.at = at;
    if (drawing.chosen && OFFERED.includes(drawing.chosen.kind)) kind.value = drawing.chosen.kind;
    const point = drawing.chosen?.points[at.point];
    if (follow && point) {
      const [px, py] = view.at(...point);
      if (px < EDGE_PX || py < EDGE_PX || px > view.width - EDGE_PX || py > view.height - EDGE_PX) view.centre(...point);
    }
    update();
  };
  const add = (point) => { drawing.add(kind.value, rounded(point)); update(); };
  const nameAxes = () => {
    for (const [input, metres, turned] of [[x, "Metres east", "Longitude"], [y, "Metres north", "Latitude"]]) {
      input.setAttribute("aria-label", degrees.checked ? turned : metres);
      input.placeholder = (degrees.checked ? turned : metres).toLowerCase();
    }
  };
  const typedPoint = () => {
    if (x.value === "" || y.value === "") return null;
    const given = [Number(x.value), Number(y.value)];
    return degrees.checked && placement ? placement.fromDegrees(...given) : given;
  };
  const tellPoint = () => {
    const point = drawing.chosen?.points[drawing.at.point];
    if (!point) return;
    const [a, b] = degrees.checked && placement ? placement.toDegrees(...point).map((one) => one.toFixed(8)) : point;
    [x.value, y.value] = [String(a), String(b)];
  };

  const typed = button("Add corner", () => { const point = typedPoint(); if (point) add(point); x.focus(); }, "small");
  const shift = button("Move it there", () => { const point = typedPoint(); if (point) { drawing.mark(); drawing.moveTo(point); update(); } }, "small");
  const another = button("Begin another", () => choose({ shape: -1, point: -1 }), "small");
  const undo = button("Undo", () => { drawing.undo(); update(); }, "small");
  const lessPoint = button("Remove point", () => { drawing.removePoint(); update(); }, "small"), lessShape = button("Remove shape", () => { drawing.removeShape(); update(); }, "small");
  const use = button(field ? "Save as a new field" : "Use this field", () => save(false), "main"), replace = button(t`Replace ${fileName}`, () => save(true), "", { hidden: !mayReplace });
  const beside = button("Where the chosen field is", () => { const at = near(); if (at) { place.value = at.map((one) => one.toFixed(6)).join(", "); goTo(place.value); } }, "small", { hidden: !near() });
  size.addEventListener("change", () => { if (Number(size.value) > 0) { drawing.mark(); drawing.chosen.properties[sizeOf(drawing.chosen.kind)] = Number(size.value); update(); } });
  title.addEventListener("change", () => { drawing.mark(); drawing.chosen.properties.name = title.value.trim(); update(); });

  view.node.classList.add("drawing");
  view.clicked = (point) => ready && add(point);
  view.dragged = (phase, at) => {
    if (phase === "start") {
      const hit = handleAt(view, drawing, at);
      if (hit?.middle) drawing.insert(hit.shape, hit.point, rounded(at));
      if (hit) choose(hit.middle ? drawing.at : { shape: hit.shape, point: hit.point });
      marked = Boolean(hit?.middle);
      return Boolean(hit);
    }
    if (phase === "move" && view.moved) {
      if (!marked) drawing.mark();
      marked = true;
      drawing.moveTo(rounded(at));
      tellPoint();
      view.redraw();
    }
    if (phase === "end") update();
    return true;
  };
  view.canvas.addEventListener("keydown", (event) => {
    const step = STEPS[event.key], point = drawing.chosen?.points[drawing.at.point];
    if ((event.key === "Delete" || event.key === "Backspace") && point) drawing.removePoint();
    else if (event.key === "z" && (event.ctrlKey || event.metaKey)) drawing.undo();
    else if (step && event.shiftKey && point) { drawing.mark(); drawing.moveTo(rounded([point[0] + step[0], point[1] + step[1]])); }
    else return;
    event.preventDefault();
    event.stopImmediatePropagation();
    update();
  }, true);
  view.layers = [(ctx) => { if (!view.backed) grid(ctx, view); }, (ctx) => shapeLayer(ctx, view, drawing)];
  view.fit([-20, -20, 220, 120]);

  const update = () => {
    const shape = drawing.chosen, boundary = drawing.shapes.find((one) => one.kind === "boundary"), corners = boundary?.points.length ?? 0;
    const inside = drawing.shapes.filter((one) => ["hole", "area", "pole", "ditch"].includes(one.kind)).length;
    const more = [inside ? t`, ${inside} in it` : "", ". ", translate("Points can be dragged."), drawing.unfinished.length ? ` ${translate("A shape with too few points is not saved.")}` : ""].join("");
    say(words, corners < 3 ? t`Tap the corners of the field (${corners} so far; a grid line is ${gridStep(view)} m).` : t`${corners} corners, ${hectares(drawing.area)}` + more);
    put(points, option("-1 -1", "none", !shape), drawing.shapes.flatMap((one, s) => one.points.map((point, p) => option(`${s} ${p}`, `${translate(KINDS[one.kind].words)}${one.properties.name && one.kind !== "boundary" ? ` ${one.properties.name}` : ""} ${p + 1}: ${point.map((value) => number(value, 1)).join(", ")}`, s === drawing.at.shape && p === drawing.at.point))));
    const unit = shape && sizeOf(shape.kind), named = shape && ["pole", "area", "ditch", "guidance"].includes(shape.kind);
    sizeLabel.hidden = !unit;
    titleLabel.hidden = !named;
    if (unit) { say(sizeLabel.firstChild, unit === "radius_m" ? "Radius, m" : "Width, m"); size.value = String(shape.properties[unit] ?? 1); }
    if (named) title.value = shape.properties.name ?? "";
    const point = shape?.points[drawing.at.point];
    shift.disabled = lessPoint.disabled = !point;
    lessShape.disabled = !shape;
    another.disabled = !shape || Boolean(KINDS[shape.kind].one);
    use.disabled = replace.disabled = corners < 3;
    undo.disabled = !drawing.past.length;
    put(legend, mapLegend(drawnEntries(drawing.shapes)));
    if (corners > 1) view.box = boxOf(boundary.points);
    tellPoint();
    view.redraw();
  };

  const save = (replacing) => {
    put(trouble);
    if (place.value.trim() && !placement) return put(trouble, note(t`The place is "${place.value}"; give longitude and latitude in degrees, such as 12.345, 51.678, or leave it empty.`, "error"));
    const shapes = placement ? drawing.shapes : drawing.shapes.map((one) => ({ ...one, points: one.points.map(([a, b]) => [a + origin[0], b + origin[1]]) }));
    const stem = replacing ? fileName : name.value.trim() || "myfield", header = placement && field ? field.geojson.headland : null;
    const text = JSON.stringify(geojsonOf(shapes, field && replacing ? field.name : stem, { out: placement && (([a, b]) => placement.toDegrees(a, b)), header }));
    saved(new File([text], `${stem}.geojson`, { type: "application/geo+json" }), { name: stem, local: !placement, replace: replacing }, trouble);
  };

  // The place on the earth of a new drawing; text that is no place is told when it is saved.
  const goTo = async (text) => {
    const [lon, lat, more] = text.split(/[,; ]+/).filter(Boolean).map(Number);
    placement = null;
    if (text.trim() && more === undefined && Math.abs(lon) <= 180 && Math.abs(lat) < 84) {
      try { placement = await placementAt(lon, lat); put(trouble); } catch (error) { put(trouble, note(error.message, "error")); }
    }
    settle([-200, -150, 200, 150]);
  };
  const settle = (box) => {
    inDegrees.hidden = !placement;
    if (!placement) { degrees.checked = false; nameAxes(); }
    view.setGrounds(placement ? [{ crs: placement.answer.crs, origin: field?.origin_m ?? placement.answer.origin_m, box }] : []);
    update();
  };
  const load = async () => {
    const box = boxOf(field.rings_m.flat());
    placement = field.crs ? await placementOf(field.crs, field.origin_m, [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2]) : null;
    if (field.crs && !placement) return put(trouble, note("This field cannot be changed here: the service does not know where it lies.", "error"));
    origin = field.crs ? [0, 0] : field.origin_m;
    drawing = new Drawing(shapesOf(field.geojson, placement ? (point) => rounded3(placement.fromDegrees(...point)) : ([a, b]) => [a - origin[0], b - origin[1]]));
    ready = true;
    name.value = t`${fileName} changed`;
    view.fit(box);
    settle(box);
  };
  const node = el("div", { class: "stack editor" }, view.node, words, legend,
    el("div", { class: "row" }, el("div", { class: "grow" }, labelled("Draw", kind)), el("div", { class: "grow" }, labelled("Chosen point", points))),
    el("div", { class: "row" }, undo, another, lessPoint, lessShape),
    el("div", { class: "row" }, el("div", { class: "grow" }, x), el("div", { class: "grow" }, y), typed, shift), inDegrees,
    el("div", { class: "grid" }, sizeLabel, titleLabel),
    el("div", { class: "grid" }, labelled("Name", name), !field && labelled("Place of 0, 0", place, "Longitude, latitude; leave empty for local metres.")), !field && beside, trouble, el("div", { class: "actions" }, use, replace));
  node.addEventListener("keydown", (event) => { if (event.key === "Enter" && event.target.tagName === "INPUT") { event.preventDefault(); if (event.target === x || event.target === y) typed.click(); else event.target.blur(); } });
  update();
  if (field) load();
  else backgroundOf().then((about) => { if (about?.bounds_deg && !place.value) { const [w, s, e, n] = about.bounds_deg; place.placeholder = `${((w + e) / 2).toFixed(4)}, ${((s + n) / 2).toFixed(4)}`; } });
  return { node, close: () => view.close() };
}

const boxOf = (points) => [0, 1].map((k) => Math.min(...points.map((p) => p[k]))).concat([0, 1].map((k) => Math.max(...points.map((p) => p[k]))));
const rounded3 = (point) => point.map((one) => Math.round(one * 1000) / 1000);
