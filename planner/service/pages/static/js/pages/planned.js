// A planning job: its progress, then the ranked table, each plan on the map, played back, and sent out.
import { el, put, button, heading, note, labelled, option, facts, sorry } from "../dom.js";
import { get, post, part, saveNamed } from "../api.js";
import { followJob, results, reportFrame } from "../jobs.js";
import { PlanMap } from "../planmap.js";
import { changeActions, whyLocked } from "../shelf.js";
import { planAgain } from "./plan.js";
import { sheet } from "../table.js";
import { clock, number, percent, plural } from "../words.js";

export async function open(main, shell, [id]) {
  const asked = await get(`plans/${part(id)}`), closing = [];
  const name = asked.name || asked.request?.field || "Plan";
  shell.title(`Plan of ${name}`);
  const again = () => button("Change and plan again", () => planAgain(asked.request ?? {})), me = await get("me").catch(() => null);
  const job = followJob("plans", id, { again: again(), done: (done, node) => shown(done, node, closing).then(() => node.append(changeSection(done, me, again()))).catch((error) => put(node, sorry(error))) });
  put(main, el("p", { class: "small" }, el("a", { href: "#/plan" }, "\u2039 Plan a field")), heading(name, askedWords(asked.request)), job.node);
  closing.push(job.close);
  return () => closing.forEach((close) => close());
}

// Rename, copy and delete the plan, or begin another with its values.
function changeSection(job, me, again) {
  const changed = (key) => { if (key === job.id) return location.reload(); location.hash = key ? `#/plan/${part(key)}` : "#/library/plans"; };
  const why = whyLocked(job, me);
  return el("section", { class: "panel stack" }, el("h2", {}, "Change"), el("div", {}, again), why && el("p", { class: "small soft" }, why), changeActions("plans", job, me, changed));
}

const askedWords = (request = {}) =>
  [request.field, request.width && `${request.width} m wide`, request.tractors && `tractors ${request.tractors}`, request.deadline && `done by ${request.deadline}`].filter(Boolean).join(" \u00B7 ");

async function shown(job, node, closing) {
  const path = `plans/${part(job.id)}/results/`, trouble = el("div");
  const [answer, maps] = await Promise.all([get(`${path}result.json`), get(`${path}maps.json`).catch(() => ({ plans: [] }))]);
  const plans = answer.plans.filter((one) => one.feasible), refused = answer.plans.filter((one) => !one.feasible);
  const best = answer.best ?? plans[0];
  if (!best) return put(node, note(answer.unmet ?? "No plan is feasible.", "warn"), refusedTable(refused), results("plans", job, (error) => put(trouble, sorry(error))), trouble);
  const map = new PlanMap(), figures = el("div"), send = el("div");
  closing.push(() => map.close());
  let chosen = best;
  const mapOf = (plan) => maps.plans.find((one) => one.strategy === plan.strategy && one.tractors === plan.tractors);
  const choose = (plan, scroll = true) => {
    chosen = plan;
    const found = mapOf(plan);
    map.node.hidden = !found;
    if (found) map.show(found);
    put(figures, facts(figuresOf(plan)));
    const first = plan.strategy === best.strategy && plan.tractors === best.tractors;
    put(send, el("div", { class: "stack" }, sendOut(job, plan, first), terminals(job, plan, first)));
    table.draw();
    if (scroll) map.node.scrollIntoView({ block: "start" });
  };
  const table = sheet("Ranked plans", columnsOf(plans, (plan) => button(plan === chosen ? "on map" : "show", () => choose(plan), "small",
    { "aria-pressed": String(plan === chosen), "aria-label": `Show plan ${plan.rank} on the map`, disabled: !mapOf(plan) })), plans, { chosen: (plan) => plan === chosen });
  const report = el("details", { class: "panel" }, el("summary", {}, "Full report"));
  report.addEventListener("toggle", async () => { if (report.open && !report.querySelector("iframe")) report.append(await reportFrame("plans", job.id, "Report of the plan")); });
  put(node, el("p", {}, [answer.advice, answer.unmet].flat().filter(Boolean).join(" ") || `Best: ${best.strategy} with ${plural(best.tractors, "tractor")}, ${clock(best.time_s)}.`),
    map.node, figures, send,
    el("section", { class: "panel" }, el("h2", {}, "Plans, best first"), table.node, plans.some((one) => one.remark) && el("p", { class: "small soft" }, "Remarks on plans are in the report.")),
    refusedTable(refused), report,
    el("section", { class: "panel" }, el("h2", {}, "Save"), results("plans", job, (error) => put(trouble, sorry(error))), trouble));
  choose(plans.find((one) => one.rank === best.rank) ?? best, false);
}

const figuresOf = (plan) => [["Time", clock(plan.time_s)], ["Fleet", plural(plan.tractors, "tractor")], ["Strategy", plan.strategy], ["Cost", number(plan.cost, 2)], ["Worked", percent(plan.worked_pct)],
  ["Missed", number(plan.missed_m2, 0, "m\u00B2")], ["Waiting", clock(plan.waiting_s)], ...(plan.finish_probability === null || plan.finish_probability === undefined ? [] : [["In time", percent(100 * plan.finish_probability)]])];

function columnsOf(plans, action) {
  const has = (key) => plans.some((plan) => plan[key] !== null && plan[key] !== undefined);
  const column = (head, key, text, more = {}) => ({ head, value: (plan) => plan[key], text: (plan) => text(plan[key]), ...more });
  return [
    column("Rank", "rank", String), { head: "Map", node: action, words: true }, column("Tractors", "tractors", String), column("Strategy", "strategy", String, { words: true }),
    column("Time", "time_s", clock), column("To finish", "finished_s", clock, { title: "Time including the missed ground" }), column("Cost", "cost", (value) => number(value, 2)),
    ...(has("meets_deadline") ? [column("In time", "meets_deadline", (value) => (value ? "yes" : "no"))] : []),
    ...(has("finish_probability") ? [column("In time %", "finish_probability", (value) => number(100 * value, 1)), column("P80", "p80_s", clock), column("Expected cost", "expected_cost", (value) => number(value, 2))] : []),
    column("Worked %", "worked_pct", (value) => number(value, 1)), column("Missed m\u00B2", "missed_m2", (value) => number(value, 0)), column("Turning", "turning_s", clock),
    column("Waiting", "waiting_s", clock), column("Clearance m", "min_clearance_m", (value) => number(value, 2)),
  ];
}

const refusedTable = (rows) => rows.length > 0 && el("details", { class: "panel" }, el("summary", {}, `${plural(rows.length, "plan")} not possible, with the reason`),
  sheet("Plans that are not possible", [{ head: "Tractors", text: (row) => String(row.tractors) }, { head: "Strategy", text: (row) => row.strategy, words: true }, { head: "Reason", text: (row) => row.reason ?? "", words: true, wrap: true }], rows).node);

const fileOf = (plan, best) => (best ? "plan.json" : `plan-${plan.strategy}-${plan.tractors}.json`);

// The chosen plan as lines for the terminals of tractors, and for maps.
const FORMS = [["isoxml4", "ISOXML 4 (TASKDATA)"], ["isoxml3", "ISOXML 3 (TASKDATA)"], ["agopengps", "AgOpenGPS"], ["shapefile", "Shapefile"],
  ["geojson", "GeoJSON"], ["kml", "KML"], ["gpx", "GPX"]];

function terminals(job, plan, best) {
  const form = el("select", { name: "form" }, FORMS.map(([value, words]) => option(value, words))), trouble = el("div");
  const which = el("select", { name: "of" }, option("", "all tractors"), Array.from({ length: plan.tractors }, (_, k) => option(String(k + 1), `tractor ${k + 1}`)));
  const go = button("Save for the terminal", async () => {
    const query = `to=${form.value}${which.value && `&tractor=${which.value}`}`, before = `${job.name || "plan"}${which.value && `-tractor-${which.value}`}`;
    go.disabled = true;
    put(trouble);
    try { await saveNamed(`plans/${part(job.id)}/results/${part(fileOf(plan, best))}/export?${query}`, before); } catch (error) { put(trouble, sorry(error)); }
    go.disabled = false;
  });
  return el("details", { class: "panel" }, el("summary", {}, "Guidance for terminals"), el("p", { class: "small soft" }, "Boundary, headland and the lines of this plan in driving order."),
    el("div", { class: "row" }, el("div", { class: "grow" }, labelled("Form", form)), el("div", { class: "grow" }, labelled("Lines of", which)), go), trouble);
}

// The chosen plan becomes a fleet.
function sendOut(job, plan, best) {
  const name = el("input", { value: `${job.name || job.request?.field || "fleet"}`.slice(0, 60), maxlength: "60" }), trouble = el("div");
  const go = button("Send out", async () => {
    go.disabled = true;
    try {
      const fleet = await post("fleets", { name: name.value, plan: job.id, result: fileOf(plan, best) });
      location.hash = `#/fleet/${part(fleet.id)}`;
    } catch (error) {
      put(trouble, sorry(error));
      go.disabled = false;
    }
  }, "main");
  return el("details", { class: "panel" }, el("summary", {}, "Send this plan out"), el("p", { class: "small soft" }, "Creates a fleet from this plan: its tractors connect, and you start it on its page."),
    el("div", { class: "row" }, el("div", { class: "grow" }, labelled("Name of the fleet", name)), go), trouble);
}
