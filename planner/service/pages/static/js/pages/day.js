// A day of several fields and fleets: the day file as text, edited here or uploaded; then the result.
import { el, put, button, heading, note, labelled, sorry, lookingOnly } from "../dom.js";
import { get, post, part, token } from "../api.js";
import { filePicker } from "../files.js";
import { earlier, followJob, reportFrame, results } from "../jobs.js";

const DRAFT = "headland-day";

export async function open(main, shell, [id = null]) {
  shell.title("Day");
  if (id) return report(main, id);
  const trouble = el("div"), text = el("textarea", { name: "day", rows: "18", spellcheck: "false", value: sessionStorage.getItem(DRAFT) ?? "" });
  text.addEventListener("input", () => sessionStorage.setItem(DRAFT, text.value));
  const set = (value) => { text.value = value; sessionStorage.setItem(DRAFT, value); };
  const file = el("input", { type: "file", accept: ".toml" });
  file.addEventListener("change", async () => { if (file.files.length) set(await file.files[0].text()); });
  const example = button("Start from the example", async () => {
    const answer = await fetch("static/example-day.toml");
    if (answer.ok) set(await answer.text()); else put(trouble, note("The example could not be read.", "error"));
  }, "small");
  const farm = await filePicker("farms", "Farm instead of the one the day names", { accept: ".toml", none: "the one the day names" });
  const rain = el("input", { name: "rain" });
  const run = button("Plan the day", async () => {
    run.disabled = true;
    put(trouble);
    const request = { day: text.value };
    if (farm.value()) request.farm = farm.value();
    if (rain.value.trim()) request.rain = rain.value.trim();
    try { location.hash = `#/day/${part((await post("days", request)).id)}`; } catch (error) { put(trouble, sorry(error)); } finally { run.disabled = false; }
  }, "main");
  put(main, heading("Day", "Several fields and fleets: who works which field in what order, and how likely each is in time."), !token.get() && lookingOnly(),
    el("div", { class: "stack steps" },
      el("section", { class: "panel stack" }, el("h2", {}, "The day"), el("div", { class: "two even" }, labelled("Day file", file, "TOML; it appears below and can be edited there."), el("div", {}, example)), labelled("Text of the day", text)),
      el("section", { class: "panel stack" }, el("h2", {}, "Farm and rain"), el("div", { class: "two even" }, farm.node, labelled("Rain instead of the day's", rain, "17:00, or 16:30=20,17:00=50 in percent"))),
      trouble, el("div", { class: "row" }, run), await earlier("days", "day", "Earlier days")));
}

async function report(main, id) {
  const asked = await get(`days/${part(id)}`), trouble = el("div");
  const job = followJob("days", id, {
    again: el("a", { class: "button", href: "#/day" }, "Change the day"),
    done: async (done, node) => put(node, el("div", { class: "panel flush" }, await reportFrame("days", id, "Plan of the day")),
      el("section", { class: "panel" }, el("h2", {}, "Save"), results("days", done, (error) => put(trouble, sorry(error))), trouble)),
  });
  put(main, el("p", { class: "small" }, el("a", { href: "#/day" }, "\u2039 Day")), heading(asked.name || "Day", ""), job.node);
  return job.close;
}
