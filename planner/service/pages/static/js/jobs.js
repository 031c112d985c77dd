// Jobs: progress in words, cancel, the sentence of a failure, and the results.
import { el, put, say, button, note, sorry } from "./dom.js";
import { t, translate } from "./language.js";
import { get, post, items, save, part } from "./api.js";
import { capital, moment, percent, size, DASH } from "./words.js";

const LOOK_MS = 700, SHOWN_EARLIER = 12, ENDS = new Set(["done", "failed", "cancelled"]);

/** What is being done now, in words and as a bar; `tell(words, done, all)`, without numbers where they are unknown. */
export function progressBar() {
  const words = el("p", { role: "status" }, "Loading\u2026"), bar = el("progress", { "aria-label": "Progress" });
  const tell = (doing, done = null, all = null) => {
    if (all) { bar.max = all; bar.value = done; } else bar.removeAttribute("value");
    const stage = capital(translate(doing));
    say(words, all ? t`${stage}: ${done} of ${all}, ${percent((100 * done) / all)}` : stage);
  };
  return { node: [words, bar], tell };
}

/** Follow a job until it ends, then call `done(job)`. Returns a node and a function that stops following. */
export function followJob(kind, id, { done, again = null, job: first = null }) {
  const node = el("div", { class: "stack" }), progress = progressBar();
  const path = `${kind}/${part(id)}`, error = el("div");
  const cancel = button("Cancel", async () => { cancel.disabled = true; await post(`${path}/cancel`).catch(failed); }, "danger");
  const running = el("div", { class: "panel stack" }, progress.node, el("div", { class: "row" }, cancel));
  const failed = (why) => put(error, note(why.message, "error"));
  let timer = 0, closed = false;
  const look = async () => {
    let job;
    try { job = await get(path); put(error); } catch (why) {
      if (closed) return;
      failed(why);
      if (why.status !== 404) timer = setTimeout(look, 3 * LOOK_MS);
      return;
    }
    if (closed) return;
    if (!ENDS.has(job.status)) {
      tell(job);
      timer = setTimeout(look, LOOK_MS);
      return;
    }
    running.remove();
    if (job.status === "done") return done(job, node);
    const sentence = job.error || (job.status === "cancelled" ? "It was cancelled." : "It failed; the service gave no reason.");
    put(node, note(sentence, job.status === "failed" ? "error" : ""), again && el("div", { class: "actions" }, again));
  };
  const tell = (job) => {
    const { done: part = null, all = null, words = "" } = job.progress ?? {};
    progress.tell(job.status === "queued" ? "Waiting for its turn." : words || "Starting", part, all);
  };
  if (first && !ENDS.has(first.status)) tell(first);
  put(node, running, error);
  look();
  return { node, close: () => { closed = true; clearTimeout(timer); } };
}

/** Buttons that save the results of a job. */
export function results(kind, job, trouble) {
  const names = (job.results ?? []).map((one) => (typeof one === "string" ? one : one.name));
  return el("div", { class: "row" }, names.filter((name) => !/^plan-/.test(name)).map((name) =>
    button(name, () => save(`${kind}/${part(job.id)}/results/${part(name)}`, `${job.name || kind}-${name}`).catch(trouble), "small", { "aria-label": t`Save ${name}` })));
}

export const STATES = { queued: "", running: "warn", done: "good", failed: "off", cancelled: "" };

/** Earlier jobs of a kind, newest first, as a list of links. */
export async function earlier(kind, address, title) {
  const jobs = await items(kind), node = el("div", { class: "cards" });
  const newest = [...jobs].sort((a, b) => String(b.created).localeCompare(String(a.created)));
  put(node, newest.length ? newest.slice(0, SHOWN_EARLIER).map((job) => el("a", { class: "tile", href: `#/${address}/${part(job.id)}` },
    el("div", { class: "grow" }, el("b", {}, job.name || job.id), el("p", { class: "small soft" }, moment(job.created))),
    el("span", { class: `badge ${STATES[job.status] ?? ""}` }, job.status ?? DASH))) : el("p", { class: "soft" }, "None yet."));
  const more = newest.length > SHOWN_EARLIER && el("p", {}, el("a", { class: "small", href: `#/library/${kind}` }, "All of them are in the library."));
  return el("section", {}, el("h2", {}, title), node, more);
}

/** A report page of a job in a box that can reach nothing of this page; it has a policy of its own, so it has a URL. */
export async function reportFrame(kind, id, title) {
  const path = `${kind}/${part(id)}/results/page.html`, place = el("div");
  const address = async () => new URL(`api/v1/${(await post(`${path}/view`)).path}`, document.baseURI);
  const alone = button("Open the report alone", async () => {
    try { window.open(await address(), "_blank", "noopener"); } catch (error) { put(place, sorry(error)); }
  }, "small");
  const frame = el("iframe", { class: "report", title, sandbox: "allow-scripts", src: await address().catch(() => new URL(`api/v1/${path}`, document.baseURI)) });
  const whole = document.createDocumentFragment();
  whole.append(frame, el("div", { class: "under" }, el("div", {}, alone), place, el("p", { class: "small soft" }, "The report prints from a window of its own.")));
  return whole;
}

export const fileWords = (one) => [one.sample ? translate("sample") : size(one.size), one.created ? moment(one.created) : ""].filter(Boolean).join(", ");
