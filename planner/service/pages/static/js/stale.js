// What is no longer so: the age of data in words, and a cover over pictures that have no link.
import { el, say } from "./dom.js";
import { t } from "./language.js";
import { span } from "./words.js";

/** A cover over a picture while fleets have no link; over several fleets a band names those without one. */
export function linkCover(lives) {
  const words = el("b", { role: "status" }), more = el("span", { "aria-hidden": "true" });
  const node = el("div", { class: "cover", hidden: true }, words, more);
  const update = () => {
    const all = lives(), lost = all.filter((live) => live.link !== "online"), first = lost[0];
    node.hidden = !lost.length;
    if (!lost.length) return;
    node.classList.toggle("band", lost.length < all.length);
    const silence = first.silence(), named = lost.length < all.length ? lost.map((live) => live.name).join(", ") : "";
    say(words, silence === null && first.link === "connecting" ? "Connecting" : named ? t`No link to ${named}` : "No link");
    say(more, silence === null ? "" : t`what you see is ${span(Math.max(silence, 1))} old`);
  };
  return { node, update };
}

/** A cover over the drawn view of one tractor: no link to the service, or nothing new from the tractor. */
export function tractorCover(live, number) {
  const words = el("b", { role: "status" }), more = el("span", { "aria-hidden": "true" });
  const node = el("div", { class: "cover", hidden: true }, words, more);
  const update = () => {
    const linked = live.link === "online", old = live.age(number), fix = live.fixes.get(number);
    const gone = fix?.connection && fix.connection !== "online";
    node.hidden = linked && !gone;
    say(words, linked ? "No link to the tractor" : "No link");
    say(more, old === null ? "" : t`what you see is ${span(Math.max(old, 1))} old`);
  };
  return { node, update };
}
