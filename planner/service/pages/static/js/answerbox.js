// A box with the answer of the moment; its texts change in place, and its figures stay where they are.
import { el, say } from "./dom.js";
import { t, translate, translateAll } from "./language.js";
import { costOf, endOf } from "./planfigures.js";
import { DASH, chance, doneBy, money, percent, plural } from "./words.js";

const WIDE = matchMedia("(min-width:1025px)"); // the box stands beside the form, with room for the table
const COLUMNS = ["Tractors", "Done", "Cost", "Worked", "In time"];

/** `show(answer, {isDriven, isLatest, words})` fills it, `wait()` marks that another answer is due, `tell(words)` says what is done. */
export function answerBox() {
  const mark = el("span", { class: "badge warn" }, "estimated"), state = el("p", { class: "small soft state" }, "Loading\u2026");
  const place = el("a", { class: "small", onclick: () => box.kept() }, "Show the plan"), rows = [];
  const values = COLUMNS.slice(0, 4).map(() => el("dd", {}, DASH)), figures = el("dl", { class: "facts" }, COLUMNS.slice(0, 4).map((name, k) => el("div", {}, el("dt", {}, name), values[k])));
  const body = el("tbody"), heads = COLUMNS.map((name) => el("th", { scope: "col" }, name));
  const table = el("div", { class: "scroll rows", tabindex: "0", role: "region", "aria-label": "Each number of tractors" }, el("table", {}, el("thead", {}, el("tr", {}, heads)), body));
  const reason = el("p", { class: "reason", hidden: true });
  const details = el("details", { open: WIDE.matches }, el("summary", {}, "Each number of tractors"), table);
  const head = el("div", { class: "now" }, el("div", { class: "title" }, el("h2", {}, "Answer"), mark), figures, el("div", { class: "line" }, state, place));
  const node = el("section", { class: "answer", "aria-label": "Answer" }, head, reason, details);
  mark.hidden = place.hidden = true;
  WIDE.onchange = () => { details.open = WIDE.matches; };

  const row = (index) => {
    while (rows.length <= index) {
      const cells = COLUMNS.map(() => el("td")), line = el("tr", {}, cells);
      body.append(line);
      rows.push({ line, cells });
    }
    return rows[index];
  };
  const fill = (plans, answer) => {
    plans.forEach((plan, index) => {
      const { line, cells } = row(index), texts = [String(plan.tractors), ...figuresOf(plan, answer)];
      cells.forEach((cell, k) => say(cell, texts[k]));
      line.classList.toggle("chosen", plan.tractors === answer.recommended);
      line.hidden = false;
    });
    for (const { line } of rows.slice(plans.length)) line.hidden = true;
  };
  const caution = (text) => { say(reason, translateAll(text)); reason.hidden = !text; };
  const box = {
    node,
    kept() {},
    wait() { node.setAttribute("aria-busy", "true"); },
    /** Without figures, until the next answer. */
    empty() {
      values.forEach((value) => say(value, DASH));
      fill([], {});
      mark.hidden = place.hidden = true;
      caution("");
      box.tell("Loading\u2026");
    },
    tell(words) { say(state, words); },
    show(answer, { isDriven, isLatest, words }) {
      const best = answer.plans.find((plan) => plan.tractors === answer.recommended), texts = best ? [String(best.tractors), ...figuresOf(best, answer)] : [DASH, DASH, DASH, DASH];
      values.forEach((value, k) => say(value, texts[k]));
      fill(answer.plans, answer);
      mark.hidden = isDriven;
      place.hidden = !isDriven;
      if (isDriven) place.href = answer.address;
      caution(answer.caution ?? "");
      box.tell(best ? words : answer.plans.find((plan) => plan.reason)?.reason ?? "No plan is possible.");
      if (isLatest) node.setAttribute("aria-busy", "false");
    },
    refuse(sentence) {
      box.empty();
      box.tell(sentence);
      node.setAttribute("aria-busy", "false");
    },
    /** All of it in a sentence. */
    words: () => (mark.hidden || values[0].textContent === DASH ? state.textContent : [t`${plural(Number(values[0].textContent), "tractor")}, done ${values[1].textContent}, cost ${values[2].textContent}, ${translate("estimated")}`, reason.textContent].filter(Boolean).join(". ")),
  };
  return box;
}

// Done, cost, worked share and whether it is in time, of a plan that may not be possible.
const figuresOf = (plan, { start, currency }) => (plan.feasible ? [doneBy(start, endOf(plan)), money(costOf(plan), currency ?? ""), percent(plan.worked_pct), inTime(plan)] : [DASH, DASH, DASH, DASH]);
const inTime = ({ finish_probability: probability, in_time: estimated, meets_deadline: driven }) => {
  if (typeof probability === "number") return `${chance(probability)}\u00A0%`;
  const answer = estimated ?? driven;
  return answer === null || answer === undefined ? DASH : translate(answer ? "yes" : "no");
};
