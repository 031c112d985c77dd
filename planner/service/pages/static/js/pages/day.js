// A day of several fields and fleets: a form and its text, two views of one day file; then the result.
import { el, put, button, heading, labelled, sorry, lookingOnly } from "../dom.js";
import { get, items, post, part, token } from "../api.js";
import { tomlForm } from "../form.js";
import { earlier, followJob, reportFrame, results } from "../jobs.js";
import { DAY } from "../layouts.js";
import { changeActions, whyLocked } from "../shelf.js";

const DRAFT = "headland-day", EMPTY = "# A day for Headland\nfarm = \"example\"\nstart = \"07:00\"\n";

export async function open(main, shell, [id = null]) {
  shell.title("Day");
  if (id) return report(main, id);
  const trouble = el("div"), lists = { fields: await items("fields"), farms: await items("farms") };
  const names = (kind) => lists[kind].map((one) => one.name);
  const choices = (name, form) => ({
    farms: () => ["example", ...names("farms")], fields: () => names("fields"),
    places: () => ["yard", ...(form.values.fields ?? []).map((one) => one?.name ?? one?.file)],
  }[name]?.() ?? form.choices[name] ?? []);
  const form = tomlForm("day", DAY, { choices, changed: (text) => sessionStorage.setItem(DRAFT, text) });
  const file = el("input", { type: "file", accept: ".toml" });
  file.addEventListener("change", async () => { if (file.files.length) await form.set(await file.files[0].text()); file.value = ""; });
  const example = button("Start from the example", async () => { try { await form.set((await get("forms/day")).text); } catch (error) { put(trouble, sorry(error)); } }, "small");
  const fresh = button("Start anew", () => form.set(EMPTY), "small");
  const name = el("input", { name: "name", maxlength: "100" });
  const run = button("Plan the day", async () => {
    run.disabled = true;
    put(trouble);
    await form.settled();
    const request = { day: form.text() };
    if (name.value.trim()) request.name = name.value.trim();
    try { location.hash = `#/day/${part((await post("days", request)).id)}`; } catch (error) {
      put(trouble, sorry(error));
      form.focusFault();
    } finally { run.disabled = false; }
  }, "main");
  await form.set(sessionStorage.getItem(DRAFT) || EMPTY);
  put(main, heading("Day", "Several fields and fleets: who works which field in what order, and how likely each is in time."), !token.get() && lookingOnly(),
    el("section", { class: "panel stack" }, el("h2", {}, "The day"),
      el("div", { class: "two even" }, labelled("Open a day file", file, "TOML, as headland day takes it."), el("div", { class: "row" }, example, fresh)),
      labelled("What this plan is called", name, "By default: day."), form.node),
    trouble, el("div", { class: "row" }, run), await earlier("days", "day", "Earlier days"));
  return form.close;
}

async function report(main, id) {
  const [asked, me] = await Promise.all([get(`days/${part(id)}`), get("me").catch(() => null)]), trouble = el("div");
  const again = () => changeAgain(asked).catch((error) => put(trouble, sorry(error)));
  const job = followJob("days", id, {
    again: button("Change this day and plan again", again),
    done: async (done, node) => put(node, el("div", { class: "panel flush" }, await reportFrame("days", id, "Plan of the day")),
      el("section", { class: "panel stack" }, el("h2", {}, "Save"), results("days", done, (error) => put(trouble, sorry(error))), trouble),
      el("section", { class: "panel stack" }, el("h2", {}, "Change"), el("div", {}, button("Change this day and plan again", again, "small")), whyLocked(done, me) && el("p", { class: "small soft" }, whyLocked(done, me)),
        changeActions("days", done, me, (key) => { location.hash = key ? `#/day/${part(key)}` : "#/library/days"; if (key === id) location.reload(); }))),
  });
  put(main, el("p", { class: "small" }, el("a", { href: "#/day" }, "\u2039 Day")), heading(asked.name || "Day", ""), job.node);
  return job.close;
}

// The form with the day of a plan; a farm or rain that was given beside the day goes into its text.
async function changeAgain(asked) {
  const { day, farm = null, rain = null } = asked.request, changes = [["farm", farm], ["rain", rain]].filter(([, value]) => value !== null).map(([key, value]) => ({ path: [key], value }));
  const form = await post("forms/day", { text: day, changes });
  sessionStorage.setItem(DRAFT, form.text);
  location.hash = "#/day";
}
