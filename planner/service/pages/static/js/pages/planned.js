// A planning job: its progress, then the ranked table, each plan on the map, played back, and sent out.
import { el, put, say, button, heading, note, labelled, option, facts, sorry } from "../dom.js";
import { t, translate } from "../language.js";
import { get, post, part, saveNamed } from "../api.js";
import { nameTractor } from "../files.js";
import { followJob, results, reportFrame } from "../jobs.js";
import { planAddress } from "../planaddress.js";
import { costOf, endOf, lateEndOf } from "../planfigures.js";
import { PlanMap } from "../planmap.js";
import { changeActions, whyLocked } from "../shelf.js";
import { sheet } from "../table.js";
import { inUnits } from "../units.js";
import { chance, clock, doneBy, money, number, percent, plural } from "../words.js";

export async function open(main, shell, [id]) {
  const asked = await get(`plans/${part(id)}`), closing = [];
  const name = asked.name || asked.request?.field || "Plan";
  shell.title(t`Plan of ${name}`);
  const again = () => el("a", { class: "button", href: planAddress(asked.request ?? {}) }, "Change and plan again");
  const head = heading(name, askedWords(asked.request)), nameFirst = (tractor) => tractor && say(head.querySelector("h1"), `${tractor}: ${name}`);
  const job = followJob("plans", id, { job: asked, again: again(), done: (done, node) => shown(done, node, closing, nameFirst).then(() => get("me").catch(() => null)).then((me) => node.append(changeSection(done, me, again()))).catch((error) => put(node, sorry(error))) });
  put(main, el("p", { class: "small" }, el("a", { href: "#/plan" }, "\u2039 Plan a field")), head, job.node);
  nameFirst(asked.request?.tractor);
  if (asked.status !== "done") nameTractor(asked.request ?? {}).then(nameFirst);
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
  [request.field, request.width && t`${number(Number(request.width), inUnits(1, "m")[1] === "m" ? String(request.width).split(".")[1]?.length ?? 0 : 1, "m")} wide`, request.tractors && t`tractors ${request.tractors}`, request.deadline && t`done by ${request.deadline}`].filter(Boolean).join(" \u00B7 ");

async function shown(job, node, closing, nameFirst) {
  const path = `plans/${part(job.id)}/results/`, trouble = el("div");
  const [answer, maps] = await Promise.all([get(`${path}result.json`), get(`${path}maps.json`).catch(() => ({ plans: [] }))]);
  nameFirst(answer.scenario?.tractor);
  const best = answer.best ?? answer.plans.find((one) => one.feasible), plans = inOrder(answer.plans.filter((one) => one.feasible), best);
  const refused = answer.plans.filter((one) => !one.feasible), notTried = refused.filter((one) => one.is_simulated === false);
  const left = [refusedTable(refused.filter((one) => !notTried.includes(one))), notSimulated(notTried.filter((one) => one.keeps_clearance)), tooNear(notTried.filter((one) => !one.keeps_clearance), answer)];
  if (!best) return put(node, (answer.summary ?? [answer.unmet ?? "No plan is feasible."]).map((text) => note(text, "warn")), left, results("plans", job, (error) => put(trouble, sorry(error))), trouble);
  const map = new PlanMap(), figures = el("div"), send = el("div");
  closing.push(() => map.close());
  let chosen = best;
  const mapOf = (plan) => {
    const found = maps.plans.find((one) => one.strategy === plan.strategy && one.tractors === plan.tractors);
    return found && { ...found, relief: maps.relief };
  };
  const choose = (plan, scroll = true) => {
    chosen = plan;
    const found = mapOf(plan);
    map.node.hidden = !found;
    if (found) map.show(found);
    put(figures, facts(figuresOf(plan, answer)));
    const first = plan.strategy === best.strategy && plan.tractors === best.tractors;
    put(send, el("div", { class: "stack" }, sendOut(job, plan, first), terminals(job, plan, first)));
    table.draw();
    if (scroll) map.node.scrollIntoView({ block: "start" });
  };
  const table = sheet("Ranked plans", columnsOf(plans, answer, (plan) => button(plan === chosen ? "on map" : "show", () => choose(plan), "small",
    { "aria-pressed": String(plan === chosen), "aria-label": t`Show plan ${plan.rank} on the map`, disabled: !mapOf(plan) })), plans, { chosen: (plan) => plan === chosen });
  const report = el("details", { class: "panel" }, el("summary", {}, "Full report"));
  report.addEventListener("toggle", async () => { if (report.open && !report.querySelector("iframe")) report.append(await reportFrame("plans", job.id, "Report of the plan")); });
  put(node, el("div", {}, (answer.summary ?? [answer.advice, answer.unmet].filter(Boolean)).map((text, place) => el("p", { class: place ? null : "lead" }, text))),
    map.node, figures, send,
    el("section", { class: "panel" }, el("h2", {}, "Plans, best first"), table.node, plans.some((one) => one.remark) && el("p", { class: "small soft" }, "Remarks on plans are in the report.")),
    left, report,
    el("section", { class: "panel" }, el("h2", {}, "Save"), results("plans", job, (error) => put(trouble, sorry(error))), trouble));
  choose(plans.find((one) => one.rank === best.rank) ?? best, false);
}

const same = (one, other) => one.strategy === other.strategy && one.tractors === other.tractors;
const known = (value) => value !== null && value !== undefined;

// The plan to take, then the Pareto front from few tractors to many, then the others by rank.
function inOrder(plans, best) {
  const others = plans.filter((plan) => !best || !same(plan, best));
  const front = others.filter((plan) => plan.on_pareto_front).sort((one, other) => one.tractors - other.tractors);
  return [...plans.filter((plan) => best && same(plan, best)), ...front, ...others.filter((plan) => !plan.on_pareto_front)];
}

const figuresOf = (plan, { scenario, currency }) => [[scenario?.start ? "Done" : "Time", doneBy(scenario?.start, endOf(plan))], ...(known(lateEndOf(plan)) ? [["95 %", doneBy(scenario?.start, lateEndOf(plan))]] : []),
  ["Fleet", plural(plan.tractors, "tractor")], ["Strategy", plan.strategy], ["Cost", money(costOf(plan), currency ?? "")], ["Worked", percent(plan.worked_pct)],
  ["Missed", number(plan.missed_m2, 0, "m\u00B2")], ...(known(plan.left_out_m2) ? [["Left out", number(plan.left_out_m2, 0, "m\u00B2")]] : []), ["Waiting", clock(plan.waiting_s)], ...(known(plan.finish_probability) ? [["In time", `${chance(plan.finish_probability)}\u00A0%`]] : [])];

function columnsOf(plans, { scenario, currency }, action) {
  const has = (value) => plans.some((plan) => known(value(plan))), start = scenario?.start;
  const column = (head, value, text, more = {}) => ({ head, value, text: (plan) => text(value(plan)), ...more });
  const extra = (head, key, text, more = {}) => column(head, (plan) => plan[key], text, { extra: true, ...more });
  const inTime = has((plan) => plan.finish_probability) ? [column("In time %", (plan) => plan.finish_probability, chance)]
    : has((plan) => plan.meets_deadline) ? [column("In time", (plan) => plan.meets_deadline, (value) => translate(value ? "yes" : "no"))] : [];
  return [
    { head: "Map", node: action, words: true }, column("Tractors", (plan) => plan.tractors, String), column("Strategy", (plan) => plan.strategy, String, { words: true }),
    column(start ? "Done" : "Time", endOf, (seconds) => doneBy(start, seconds)), ...(has(lateEndOf) ? [column("95 %", lateEndOf, (seconds) => doneBy(start, seconds))] : []),
    column(currency ? t`Cost ${currency}` : "Cost", costOf, (value) => money(value)), column("Worked %", (plan) => plan.worked_pct, (value) => number(value, 1)), ...inTime,
    extra("Rank", "rank", String), extra("As simulated", "time_s", clock, { title: "Time without late starts, stops and breakdowns" }), extra("To finish", "finished_s", clock, { title: "Time including the missed ground" }),
    ...(has((plan) => plan.paid_cost) ? [extra("Paid", "paid_cost", (value) => money(value))] : []), extra(t`Missed ${inUnits(1, "m\u00B2")[1]}`, "missed_m2", (value) => (known(value) ? number(inUnits(value, "m\u00B2")[0], 0) : number(value))),
    extra("Turning", "turning_s", clock), extra("Waiting", "waiting_s", clock), extra(t`Clearance ${inUnits(1, "m")[1]}`, "min_clearance_m", (value) => (known(value) ? number(inUnits(value, "m")[0], 2) : number(value))),
  ];
}

const notSimulated = (rows) => rows.length > 0 && el("p", { class: "small soft" }, t`${plural(rows.length, "plan")} not simulated, as others are estimated to be faster.`);

const tooNear = (rows, { scenario }) => rows.length > 0 && el("p", { class: "small soft" }, t`${plural(rows.length, "plan")} not simulated, as tractors may come nearer than ${number(scenario.clearance_m, 1, "m")}.`);

const refusedTable = (rows) => rows.length > 0 && el("details", { class: "panel" }, el("summary", {}, t`${plural(rows.length, "plan")} not possible, with the reason`),
  sheet("Plans that are not possible", [{ head: "Tractors", text: (row) => String(row.tractors) }, { head: "Strategy", text: (row) => row.strategy, words: true }, { head: "Reason", text: (row) => row.reason ?? "", words: true, wrap: true }], rows).node);

const fileOf = (plan, best) => (best ? "plan.json" : `plan-${plan.strategy}-${plan.tractors}.json`);

// The chosen plan as lines for the terminals of tractors, and for maps.
const FORMS = [["isoxml4", "ISOXML 4 (TASKDATA)"], ["isoxml3", "ISOXML 3 (TASKDATA)"], ["agopengps", "AgOpenGPS"], ["shapefile", "Shapefile"],
  ["geojson", "GeoJSON"], ["kml", "KML"], ["gpx", "GPX"]];

function terminals(job, plan, best) {
  const form = el("select", { name: "form" }, FORMS.map(([value, words]) => option(value, words))), trouble = el("div");
  const which = el("select", { name: "of" }, option("", "all tractors"), Array.from({ length: plan.tractors }, (_, k) => option(String(k + 1), t`tractor ${k + 1}`)));
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
