// The shell: which page the address names, its title, the tabs, the colours. Every page is a module of its own.
import { el, put, note, heading, button, speak } from "./dom.js";
import { ServiceError, askOtherTabs, token } from "./api.js";
import { startTheme } from "./palette.js";
import { startLanguage, t, translate } from "./language.js";
import { startUnits } from "./units.js";

const ROUTES = [
  [/^\/?$/, "overview", "overview"],
  [/^\/fleet\/([^/]+)$/, "fleet", "overview"],
  [/^\/fleet\/([^/]+)\/tractor\/(\d+)$/, "tractor", "overview"],
  [/^\/plan$/, "plan", "plan"],
  [/^\/plan\/([^/]+)$/, "planned", "plan"],
  [/^\/day$/, "day", "day"],
  [/^\/day\/([^/]+)$/, "day", "day"],
  [/^\/diagnose$/, "diagnose", "diagnose"],
  [/^\/diagnose\/([^/]+)$/, "diagnose", "diagnose"],
  [/^\/replay$/, "replay", "replay"],
  [/^\/replay\/([^/]+)$/, "replay", "replay"],
  [/^\/library$/, "library", "library"],
  [/^\/library\/([^/]+)$/, "library", "library"],
  [/^\/farm$/, "farm", "library"],
  [/^\/farm\/([^/]+)$/, "farm", "library"],
  [/^\/access$/, "access", "access"],
];

const main = document.getElementById("main");
let close = () => {}, turn = 0;

const shell = {
  title(words) {
    document.title = `${translate(words)} \u2013 Headland`;
    speak(words);
  },
};

function tab(name) {
  for (const link of document.querySelectorAll("[data-tab]")) {
    if (link.dataset.tab === name) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
}

async function show(first = false) {
  const [, path, query] = /^#?([^?]*)\??(.*)$/s.exec(location.hash), mine = ++turn;
  const found = ROUTES.map(([rule, page, tab]) => [path.match(rule), page, tab]).find(([match]) => match);
  close();
  close = () => {};
  const box = document.createElement("div");
  box.className = "stack page";
  put(main, box);
  put(box, el("p", { class: "soft" }, "Loading\u2026"));
  tab(found?.[2]);
  if (!found) return put(main, heading("No such page"), note("There is no page at this address; choose one above.", "warn"));
  let ended = () => {};
  try {
    const page = await import(`./pages/${found[1]}.js`);
    if (mine !== turn) return;
    ended = (await page.open(box, shell, found[0].slice(1).map(decodeURIComponent), query)) ?? ended;
  } catch (error) {
    if (!(error instanceof ServiceError)) console.error(error);
    if (mine === turn) trouble(box, error);
  }
  // The user may have left for another page while this one waited for the service.
  if (mine !== turn) return ended();
  close = ended;
  if (!first) (main.querySelector("h1") ?? main).focus({ preventScroll: true });
  if (!first) window.scrollTo(0, 0);
}

function trouble(box, error) {
  const locked = error.status === 401 || error.status === 403;
  put(box, heading(locked ? "Access is needed" : "This page could not be shown"), note(error instanceof ServiceError ? error.message : t`The page has a fault (${error.message}); reload it, and report it if it stays.`, "error"));
  const ways = document.createElement("div");
  ways.className = "actions";
  ways.append(button("Try again", () => show(), "main"));
  if (error.status === 401) box.append(note("On the machine of the service, open the login address that headland serve printed; elsewhere, enter a token."));
  if (locked) {
    const link = document.createElement("a");
    link.href = "#/access";
    link.className = "button";
    link.textContent = translate("Enter a token");
    ways.append(link);
  }
  box.append(ways);
}

// The login address of a machine's own user brings a token, which then leaves the address of the page.
const brought = /^#token=(hl_[\w-]+)$/.exec(location.hash);
if (brought) {
  token.set(brought[1]);
  history.replaceState(null, "", "#/");
}

startTheme(document.getElementById("theme"));
startUnits(document.getElementById("units"));
await Promise.all([startLanguage(document.getElementById("language")), askOtherTabs()]);
window.addEventListener("hashchange", () => show());
show(true);
