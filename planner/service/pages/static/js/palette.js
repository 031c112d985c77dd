// Colours for canvases: read from the custom properties of the page, and anew when light changes to dark.
import { t, translate } from "./language.js";

const NAMES = ["ink", "soft", "rule", "line", "accent", "panel", "ground", "field", "swath", "edge", "obstacle", "sky", "halo",
  "off", "warn", "good", "t0", "t1", "t2", "t3", "t4", "t5", "t6"];
const COUNT = 7;
const watchers = new Set();

/** Whether the page is being printed: canvases then draw at once, and light. */
export const paper = { printed: false };

/** Colours by name; `colours.tractor(n)` is that of tractor `n`, from 1. */
export const colours = { tractor: (number) => colours[`t${(number - 1) % COUNT}`] };

function read() {
  const probe = document.createElement("span");
  document.body.append(probe);
  for (const name of NAMES) {
    probe.style.color = `var(--${name})`;
    colours[name] = getComputedStyle(probe).color;
  }
  probe.remove();
  watchers.forEach((watcher) => watcher());
}

/** Call a function whenever colours change; returns a function that unsubscribes. */
export function onColours(watcher) {
  watchers.add(watcher);
  return () => watchers.delete(watcher);
}

const CHOICES = ["system", "light", "dark"];
const KEY = "headland-colours";

export function startTheme(action) {
  const set = (choice) => {
    if (choice === "system") delete document.documentElement.dataset.theme;
    else document.documentElement.dataset.theme = choice;
    const words = choice === "system" ? translate("Colours: as the system") : t`Colours: ${translate(choice)}`;
    action.setAttribute("aria-label", words);
    action.title = words;
    read();
  };
  let choice = localStorage.getItem(KEY) ?? "system";
  if (!CHOICES.includes(choice)) choice = "system";
  action.addEventListener("click", () => {
    choice = CHOICES[(CHOICES.indexOf(choice) + 1) % CHOICES.length];
    localStorage.setItem(KEY, choice);
    set(choice);
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", read);
  addEventListener("beforeprint", () => { paper.printed = true; document.documentElement.dataset.theme = "light"; read(); });
  addEventListener("afterprint", () => { paper.printed = false; set(choice); });
  set(choice);
}
