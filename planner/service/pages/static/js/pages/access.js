// Access: the token of this tab. Tabs alone keep it, and new tabs get it from open ones.
import { el, put, button, heading, note, labelled, facts } from "../dom.js";
import { t, translate } from "../language.js";
import { get, token } from "../api.js";
import { DASH } from "../words.js";

export async function open(main, shell) {
  shell.title("Access");
  const about = el("div"), said = el("div"), field = el("input", { type: "password", autocomplete: "off", spellcheck: "false", name: "token", placeholder: "hl_\u2026" });
  const command = el("code", { class: "small" }, "headland token new --scope planner --scope operator");
  const shownFor = el("p", { role: "status" });
  const tell = () => put(shownFor, token.get() ? t`A token is in use in this tab; it ends in ${token.get().slice(-4)}.` : "No token is in use: this browser may view. Planning and operating need a token, or the login address that headland serve printed last.");
  const form = el("form", { class: "stack" }, labelled("Token", field, "Made on the machine of the service with this command:"), command, el("div", { class: "row" }, el("button", { class: "main" }, "Use it in this tab"),
    button("Forget it", () => { token.forget(); tell(); put(said, note("The token is forgotten.")); })));
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    const before = token.get();
    token.set(field.value.trim());
    try {
      await get("fields");
      field.value = "";
      put(said, note("The service accepts this token."));
    } catch (error) {
      token.set(before);
      put(said, note(error.message, "error"));
    }
    tell();
  });
  tell();
  put(main, heading("Access", "A planner\u2019s token adds files and jobs, an operator\u2019s controls fleets, an admin\u2019s also makes tokens; all of them can read."),
    el("div", { class: "two even" }, el("section", { class: "panel stack" }, shownFor, form, said), el("section", { class: "panel stack" }, el("h2", {}, "Service"), about)));
  const health = await get("health"), me = await get("me").catch(() => null);
  if (me?.token_command) put(command, me.token_command);
  put(about, facts([["Service", health.status ?? DASH], ["Version", health.version ?? DASH], ["You", me ? `${me.name}: ${me.rights.map(translate).join(", ") || translate("nothing")}` : "unknown: log in or enter a token"], ...(health.faults ?? []).map((fault) => ["Fault", fault])]),
    el("p", { class: "small" }, el("a", { href: "api/v1/docs" }, "API documentation")));
}
