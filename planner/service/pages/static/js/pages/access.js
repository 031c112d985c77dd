// Access: the token of this tab. It is kept in the tab alone and gone when the tab is closed.
import { el, put, button, heading, note, labelled, facts } from "../dom.js";
import { get, token } from "../api.js";
import { DASH } from "../words.js";

export async function open(main, shell) {
  shell.title("Access");
  const about = el("div"), said = el("div"), field = el("input", { type: "password", autocomplete: "off", spellcheck: "false", name: "token", placeholder: "hl_\u2026" });
  const shownFor = el("p", { role: "status" });
  const tell = () => put(shownFor, token.get() ? `A token is in use in this tab; it ends in ${token.get().slice(-4)}.` : "No token is in use. On this machine you may look; nobody may control without one.");
  const form = el("form", { class: "stack" }, labelled("Token", field, "Made on the machine of the service: headland token new --scope control"), el("div", { class: "row" }, el("button", { class: "main" }, "Use it in this tab"),
    button("Forget it", () => { token.set(null); tell(); put(said, note("The token is forgotten.")); })));
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    const before = token.get();
    token.set(field.value.trim());
    try {
      await get("fields");
      field.value = "";
      put(said, note("The service takes this token."));
    } catch (error) {
      token.set(before);
      put(said, note(error.message, "error"));
    }
    tell();
  });
  tell();
  put(main, heading("Access", "Reading, controlling and administering each need a token of that scope."),
    el("div", { class: "two even" }, el("section", { class: "panel stack" }, shownFor, form, said), el("section", { class: "panel stack" }, el("h2", {}, "Service"), about)));
  const health = await get("health");
  put(about, facts([["Service", health.status ?? DASH], ["Version", health.version ?? DASH], ["Tokens", health.tokens_needed ? "needed for all" : "needed to control"]]),
    el("p", { class: "small" }, el("a", { href: "api/v1/docs" }, "Documentation of the interface")));
}
