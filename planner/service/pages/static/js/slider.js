// A slider beside a text control: both say the same, and the text is what counts.
import { el } from "./dom.js";
import { numberOf } from "./form.js";
import { translate } from "./language.js";

const two = (value) => String(value).padStart(2, "0");

/** How the text of a control becomes the place of a slider, null where it says nothing, and back. */
export const NUMBERS = { read: (text) => { const value = numberOf(text); return typeof value === "number" ? value : null; }, write: (value) => String(Number(value.toFixed(2))) };
export const COUNTS = { read: (text) => { const counts = text.match(/\d+/g); return counts && Math.max(...counts.map(Number)); }, write: (value) => (value > 1 ? `1-${value}` : "1") };
export const CLOCKS = {
  read: (text) => { const [, hours, minutes] = /^(\d{1,2}):(\d{2})$/.exec(text.trim()) ?? []; return hours ? 60 * Number(hours) + Number(minutes) : null; },
  write: (minutes) => `${two(Math.floor(minutes / 60))}:${two(minutes % 60)}`, min: 0, max: 1425, step: 15,
};

/** A slider of a text control; it rests at `rest` while the text says nothing. `follow()` after the text was set. */
export function slider(label, control, { read, write, min, max, step, rest }) {
  const node = el("input", { type: "range", min, max, step, "aria-label": label, oninput: () => { control.value = write(node.valueAsNumber); follow(); } });
  const follow = () => {
    const value = read(control.value);
    node.value = value ?? rest;
    node.classList.toggle("unset", value === null);
    node.setAttribute("aria-valuetext", control.value.trim() || translate("not given"));
  };
  control.addEventListener("input", follow);
  follow();
  return { node, follow };
}
