// A farm: tractors, implements, prices and times in a form and as text; saved under its name in the library.
import { el, put, button, heading, labelled, lookingOnly, sorry, speak } from "../dom.js";
import { get, items, part, text as readText, token } from "../api.js";
import { addFile } from "../files.js";
import { tomlForm } from "../form.js";
import { FARM } from "../layouts.js";
import { t } from "../language.js";

export async function open(main, shell, [known = null]) {
  shell.title(known ?? "New farm");
  const trouble = el("div", { class: "stack" }), tractors = (await items("tractors")).map((one) => one.name);
  const form = tomlForm("farm", FARM, { choices: (name, now) => (name === "tractorFiles" ? tractors : now.choices[name] ?? []) });
  const name = el("input", { name: "name", value: known ?? "farm", maxlength: "100" });
  const save = button("Save the farm", async () => {
    await form.settled();
    const stem = name.value.trim() || "farm", file = new File([form.text()], `${stem}.toml`, { type: "application/toml" });
    save.disabled = true;
    await addFile("farms", file, trouble, (made) => {
      speak(t`${made.name} is saved.`);
      if (made.name === known) return put(saved, t`Saved as ${made.name}; plans from now on use it.`);
      location.hash = `#/farm/${part(made.name)}`;
    }, { name: stem, replace: stem === known });
    if (form.faults().length) form.focusFault();
    save.disabled = false;
  }, "main");
  const saved = el("p", { class: "small soft", role: "status" });
  const example = button("Start from the example", async () => { try { await form.set((await get("forms/farm")).text); } catch (error) { put(trouble, sorry(error)); } }, "small");
  await form.set(known ? await readText(`farms/${part(known)}`) : (await get("forms/farm")).text);
  put(main, el("p", { class: "small" }, el("a", { href: "#/library/farms" }, "\u2039 Farms")), heading(known ?? "New farm", "Its tractors and implements, what they cost, and when work is done. What you leave out has a usual value."),
    !token.get() && lookingOnly(),
    el("section", { class: "panel stack" }, el("h2", {}, "The farm"), el("div", { class: "two even" }, labelled("Name", name), el("div", { class: "row" }, example)), form.node),
    trouble, saved, el("div", { class: "row" }, save));
  return form.close;
}
