// The service over HTTP. Its errors are the sentences it answers with.
import { t } from "./language.js";

const TOKEN = "headland-token", ANSWER_MS = 200;
const ROOT = new URL("api/v1/", document.baseURI);

/** A refusal in the service's words; `parameter` names the wrong value, if one was. */
export class ServiceError extends Error {
  constructor(sentence, status, parameter = null) {
    super(sentence);
    this.status = status;
    this.parameter = parameter;
  }
}

/** The token of this tab. A new tab gets it from one that is open; it is gone when the last of them is closed. */
export const token = {
  get: () => sessionStorage.getItem(TOKEN),
  set: (value) => (value ? sessionStorage.setItem(TOKEN, value) : sessionStorage.removeItem(TOKEN)),
  /** Forget it in all tabs that have the same. */
  forget: () => { tabs.postMessage({ forgotten: token.get() }); token.set(null); },
};

// Tabs of one browser at this service give each other the token; it is never stored on the disk.
const tabs = new BroadcastChannel(`${TOKEN} ${new URL(ROOT).pathname}`);
let answered = null; // while this tab asks
tabs.addEventListener("message", ({ data }) => {
  const own = token.get();
  if (data.wanted && own) tabs.postMessage({ token: own });
  if (data.token && answered) { token.set(data.token); answered(); }
  if (data.forgotten && data.forgotten === own) token.set(null);
});

/** Ask the other tabs for their token where this one has none; ends with the first answer, or without one in time. */
export const askOtherTabs = () => !token.get() && new Promise((done) => {
  answered = done;
  tabs.postMessage({ wanted: true });
  setTimeout(done, ANSWER_MS);
}).then(() => { answered = null; });

export function socketUrl(path) {
  const url = new URL(path, ROOT);
  url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
  return url;
}

async function ask(method, path, body = null, headers = {}, cache = "no-store") {
  const secret = token.get();
  if (secret) headers.Authorization = `Bearer ${secret}`;
  let answer;
  try {
    answer = await fetch(new URL(path, ROOT), { method, body, headers, cache, credentials: "same-origin", keepalive: method === "DELETE" });
  } catch {
    throw new ServiceError("The service does not answer; check that it is still running.", 0);
  }
  if (!answer.ok) throw await refusal(answer);
  return answer;
}

async function refusal(answer) {
  const body = await answer.json().catch(() => ({}));
  const detail = typeof body.detail === "string" ? body.detail : null;
  const sentence = body.labelled || body.error || detail || t`The service answered with status ${answer.status}.`;
  return new ServiceError(sentence, answer.status, body.parameter || null);
}

const json = async (answer) => (answer.status === 204 ? null : answer.json());

export const get = async (path) => json(await ask("GET", path));
export const text = async (path) => (await ask("GET", path)).text();
export const bytes = async (path) => (await ask("GET", path)).blob();
/** A picture, which the browser may keep; null where there is none. */
export async function picture(path) {
  const answer = await ask("GET", path, null, {}, "default");
  return answer.status === 204 ? null : createImageBitmap(await answer.blob());
}
export const remove = async (path) => json(await ask("DELETE", path));
/** Put a value in the place of another. */
export const change = async (path, body) =>
  json(await ask("PUT", path, JSON.stringify(body), { "Content-Type": "application/json" }));
export const post = async (path, body = {}) =>
  json(await ask("POST", path, JSON.stringify(body), { "Content-Type": "application/json" }));

export const patch = async (path, body) =>
  json(await ask("PATCH", path, JSON.stringify(body), { "Content-Type": "application/json" }));

/** Upload one file as form data, with its options: name, crs, swap_axes, local, replace. */
export async function upload(path, file, more = {}) {
  const form = new FormData();
  form.append("file", file, file.name);
  for (const [name, value] of Object.entries(more)) if (value) form.append(name, value);
  return json(await ask("POST", path, form));
}

/** Items of a list; empty where the service has no such list. */
export async function items(path) {
  const answer = await get(path);
  return Array.isArray(answer) ? answer : answer?.items ?? [];
}

export const part = (text) => encodeURIComponent(text);

/** Save a result under a name: fetched with the token, so a plain link will not do. */
export const save = async (path, name) => keep(await bytes(path), name);

/** Save an answer under the name that the service gives it, with a prefix if there is one. */
export async function saveNamed(path, before = "") {
  const answer = await ask("GET", path), named = /filename\*=UTF-8''([^;]+)/.exec(answer.headers.get("content-disposition") ?? "");
  keep(await answer.blob(), `${before && `${before}-`}${decodeURIComponent(named?.[1] ?? "file")}`);
}

function keep(blob, name) {
  const url = URL.createObjectURL(blob);
  const link = document.createElement("a");
  link.href = url;
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(url), 10000);
}
