// Diagnose: upload measured logs, name their tractor, and read what the simulation gets wrong and why.
import { el, put, button, heading, note, labelled, option, sorry, lookingOnly } from "../dom.js";
import { listed, t, translate } from "../language.js";
import { get, post, items, save, upload, part, token } from "../api.js";
import { filePicker } from "../files.js";
import { earlier, fileWords, followJob, reportFrame, results } from "../jobs.js";
import { span } from "../words.js";

export async function open(main, shell, [id = null]) {
  shell.title("Diagnose");
  if (id) return report(main, shell, id);
  const list = el("div", { class: "cards" }), trouble = el("div"), chosen = new Set();
  const draw = async () => {
    const logs = await items("logs");
    put(list, logs.length ? logs.map((log) => el("label", { class: "tile" },
      el("input", { type: "checkbox", checked: chosen.has(log.name), onchange: (event) => (event.target.checked ? chosen.add(log.name) : chosen.delete(log.name)) }),
      el("span", { class: "grow" }, el("b", {}, log.name), el("span", { class: "small soft" }, ` ${fileWords(log)}`)))) : el("p", { class: "soft" }, "No logs yet; add some above."));
  };
  const file = el("input", { type: "file", accept: ".csv", multiple: true });
  file.addEventListener("change", async () => {
    put(trouble);
    for (const one of file.files) {
      try { chosen.add((await upload("logs", one)).name); } catch (error) { trouble.append(note(`${one.name}: ${error.message}`, "error")); }
    }
    file.value = "";
    await draw();
  });
  await draw();
  const tractor = await filePicker("tractors", "Tractor", { accept: ".toml", first: "eg105" });
  const columns = el("input", { name: "mapping", placeholder: "time_s=Zeit speed_kmh=v" });
  const ground = el("select", { name: "ground" }, option("soil"), option("asphalt"));
  const heldOut = el("select", { name: "holdout" }, option("none"), option("auto", "a quarter of them"));
  const ask = async (request, action) => {
    action.disabled = true;
    try { location.hash = `#/diagnose/${part((await post("diagnoses", request)).id)}`; } catch (error) { put(trouble, sorry(error)); } finally { action.disabled = false; }
  };
  const holdout = () => (heldOut.value === "auto" ? { holdout: ["auto"] } : {});
  const mapping = () => (columns.value.trim() ? { mapping: pairsIn(columns.value) } : {});
  const run = button("Diagnose", () => ask({ logs: [...chosen], tractor: tractor.value(), ground: ground.value, ...holdout(), ...mapping() }, run), "main");
  const demo = button("Demonstrate with simulated logs", () => ask({ demo: true, tractor: tractor.value(), ground: ground.value }, demo));
  const sample = button("Try it with a sample log", () => ask({ logs: ["sample"] }, sample));
  put(main, heading("Diagnose", "Compares the simulation with measured logs and names what it gets wrong."), !token.get() && lookingOnly(),
    el("div", { class: "stack steps" },
      el("section", { class: "panel stack" }, el("h2", {}, "Logs"), labelled("Add logs", file, "CSV, one run per file: time_s, easting_m, northing_m, steering_command_deg or steering_deg, and more."),
        labelled("Columns under other names", columns, "What a refusal suggests can be pasted here."), list),
      el("section", { class: "panel stack" }, el("h2", {}, "Tractor and ground"), el("div", { class: "two even" }, tractor.node, labelled("Ground", ground)),
        labelled("Hold out runs", heldOut, "Runs with no part in anything show what the result is worth; a tractor file that does not help there is not saved.")),
      trouble, el("div", { class: "row" }, run, sample, demo), await earlier("diagnoses", "diagnose", "Earlier diagnoses")));
}

/** Pairs such as time_s=Zeit in a text, in quotes where a name has blanks; what stands between them is left out. */
const pairsIn = (text) => [...text.matchAll(/"([^"]+)"|([^\s"]+=[^\s"]+)/g)].map((found) => found[1] ?? found[2]);

async function report(main, shell, id) {
  const asked = await get(`diagnoses/${part(id)}`), trouble = el("div");
  const job = followJob("diagnoses", id, {
    again: el("a", { class: "button", href: "#/diagnose" }, "Choose other logs"),
    done: async (done, node) => put(node, await nextDrive(id, done, trouble), el("div", { class: "panel flush" }, await reportFrame("diagnoses", id, "Report of the diagnosis")),
      el("section", { class: "panel" }, el("h2", {}, "Save"), results("diagnoses", done, (error) => put(trouble, sorry(error))), trouble)),
  });
  put(main, el("p", { class: "small" }, el("a", { href: "#/diagnose" }, "\u2039 Diagnose")), heading(asked.name || "Diagnosis", questionWords(asked.request ?? {})), job.node);
  return job.close;
}

/** What was asked: the logs or the demonstration, the tractor and the ground. */
export function questionWords({ logs = [], demo = false, hide = null, tractor = "eg105", ground = "soil" }) {
  const hidden = hide ? t`simulated logs with the effect ${hide} hidden in them` : translate("simulated logs with an effect hidden in them");
  const driven = demo ? hidden : logs.map((name) => (name === "sample" ? translate("the sample log") : name)).join(", ");
  return t`What does the simulation of ${tractor} on ${translate(ground)} get wrong in ${driven}?`;
}

const separated = (drive) => listed(drive.separates.map((name) => translate(name.replaceAll("_", " "))));

// What would settle a doubt that the logs leave: the drive in words, and its plan to save.
async function nextDrive(id, job, trouble) {
  if (!(job.results ?? []).some((one) => (one.name ?? one) === "next-drive.json")) return null;
  const { next_drive: drive } = await get(`diagnoses/${part(id)}/results/result.json`);
  return el("section", { class: "panel stack next-drive" }, el("h2", {}, "Drive to do next"),
    el("p", {}, translate(drive.words), " ", drive.decides ? t`It decides between ${separated(drive)}; ${span(drive.seconds)}.` : t`It says most, though perhaps not enough, between ${separated(drive)}; ${span(drive.seconds)}.`),
    el("div", { class: "row" }, button("Save the plan of this drive", () => save(`diagnoses/${part(id)}/results/next-drive.json`, "next-drive.json").catch((error) => put(trouble, sorry(error))), "main")));
}
