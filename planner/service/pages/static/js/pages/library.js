// The library: everything that was added or planned, to be searched, used, renamed, copied, replaced and deleted.
import { ACCEPTED } from "../accepted.js";
import { el, put, say, heading, labelled, lookingOnly, sorry } from "../dom.js";
import { get, items, token } from "../api.js";
import { addFile, rememberChoice } from "../files.js";
import { STATES } from "../jobs.js";
import { changeActions, keyOf, whyLocked } from "../shelf.js";
import { t, translate } from "../language.js";
import { moment, plural, size } from "../words.js";

const SHELVES = {
  fields: ["Fields", "Add a field", "Plan it"], tractors: ["Tractors", "Add a tractor file", "Plan with it"], farms: ["Farms", "Add a farm file", "Edit"],
  plans: ["Plans", "", "Open"], days: ["Days", "", "Open"], diagnoses: ["Diagnoses", "", "Open"], logs: ["Logs", "Add a log", ""], tables: ["Tables", "Add a table of rain or GNSS errors", ""],
  elevations: ["Heights", "Add heights of a field", ""],
};
const USES = { fields: () => "#/plan", tractors: () => "#/plan", farms: (one) => `#/farm/${encodeURIComponent(one.name)}`, plans: (one) => `#/plan/${one.id}`, days: (one) => `#/day/${one.id}`, diagnoses: (one) => `#/diagnose/${one.id}` };
const TYPED_MS = 250;

export async function open(main, shell, [kind = "fields"]) {
  if (!(kind in SHELVES)) kind = "fields";
  const [title, adding, using] = SHELVES[kind], me = await get("me").catch(() => null);
  shell.title(`${translate(title)} \u2013 ${translate("Library")}`);
  const found = el("ul", { class: "cards" }), count = el("p", { class: "small soft", role: "status" }), trouble = el("div", { class: "stack" });
  const search = el("input", { type: "search", name: "search", placeholder: "part of a name" });
  let timer = 0, asked = 0;
  const list = async (key = null) => {
    const words = search.value.trim(), mine = ++asked;
    try {
      const all = await items(`${kind}${words ? `?search=${encodeURIComponent(words)}` : ""}`);
      if (mine !== asked) return;
      put(found, all.map((one) => card(kind, one, me, using, after)));
      say(count, all.length ? plural(all.length, "entry", "entries") : words ? t`Nothing is called ${words}.` : "Nothing is here yet.");
    } catch (error) { if (mine === asked) put(trouble, sorry(error)); }
    if (key) [...found.children].find((each) => each.dataset.key === key)?.querySelector("summary")?.focus();
  };
  const after = async (key) => { await list(key); if (key === null) search.focus(); };
  search.addEventListener("input", () => { clearTimeout(timer); timer = setTimeout(() => list(), TYPED_MS); });
  const file = el("input", { type: "file", accept: ACCEPTED[kind] ?? "" });
  file.addEventListener("change", async () => {
    if (file.files.length) await addFile(kind, file.files[0], trouble, (made) => { search.value = ""; return list(made.name); });
    file.value = "";
  });
  const shelves = el("nav", { class: "row", "aria-label": "Kinds of things" }, Object.entries(SHELVES).map(([name, [words]]) =>
    el("a", { class: "button small", href: `#/library/${name}`, "aria-current": name === kind ? "page" : null }, words)));
  put(main, heading("Library", "What you added and planned. Plans keep the files they were made of, whatever becomes of those here."), !token.get() && lookingOnly(), shelves,
    el("section", { class: "panel stack" }, el("h2", {}, title),
      el("div", { class: "two even" }, labelled("Search", search), adding ? labelled(adding, file) : kind === "farms" ? null : el("div")),
      kind === "farms" && el("div", {}, el("a", { class: "button small", href: "#/farm" }, "Write a new farm")),
      kind === "days" && el("div", {}, el("a", { class: "button small", href: "#/day" }, "Plan a new day")),
      kind === "plans" && el("div", {}, el("a", { class: "button small", href: "#/plan" }, "Plan a field")),
      trouble, count, found));
  await list();
  return () => clearTimeout(timer);
}

function card(kind, one, me, using, after) {
  const why = whyLocked(one, me), use = USES[kind];
  const when = [one.sample ? translate("sample") : null, one.size ? size(one.size) : null, moment(one.changed ?? one.created), one.owner && t`by ${one.owner}`];
  const more = el("details", {}, el("summary", { "aria-label": t`Change ${one.name}` }, "Change"));
  more.addEventListener("toggle", () => {
    if (more.open && more.children.length === 1) more.append(el("div", { class: "stack" }, why && el("p", { class: "small soft" }, why), changeActions(kind, one, me, after)));
  });
  const opener = use && el("a", { class: "button small", href: use(one), "aria-label": `${translate(using)}: ${one.name}`, onclick: () => { if (kind in ACCEPTED) rememberChoice(kind, one.name); } }, using);
  return el("li", { class: "shelf", "data-key": keyOf(kind, one) },
    el("div", { class: "row" }, el("div", { class: "grow" }, el("p", {}, el("b", {}, one.name), " ", one.status && el("span", { class: `badge ${STATES[one.status] ?? ""}` }, one.status)),
      el("p", { class: "small soft" }, when.filter((each) => each && each !== "\u2013").join(" \u00B7 "))), opener), more);
}
