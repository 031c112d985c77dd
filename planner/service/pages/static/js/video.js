// Real video of a tractor in the place of the drawn view, and the form for its address.
import { el, put, say, button, labelled, note } from "./dom.js";
import { t } from "./language.js";
import { change, part } from "./api.js";

const FILM = /\.(m3u8|mp4|webm)$/i, HLS = "application/vnd.apple.mpegurl";

/** The picture of an address: HLS and files in a video element, all else as MJPEG in an image; `failed(sentence)`. */
export function videoPicture(address, label, failed) {
  const path = new URL(address, document.baseURI).pathname;
  if (!FILM.test(path)) return el("img", { class: "camera", src: address, alt: label, onerror: () => failed("The camera does not answer at this address, or this is no MJPEG stream.") });
  const film = el("video", { class: "camera", src: address, autoplay: true, playsinline: true, controls: true, "aria-label": label, onerror: () => failed("The video cannot be played: the camera or gateway does not answer, or this browser cannot play it.") });
  film.muted = true; // browsers start a film by themselves only without sound
  if (/m3u8$/i.test(path) && !film.canPlayType(HLS)) setTimeout(() => failed("This browser cannot play HLS by itself. Safari, and Chrome and Edge of late, can; an MJPEG address plays in every browser."));
  return film;
}

/** The view of a tractor: video where an address is set, else drawn; a choice between both, and the form. */
export function viewPanel({ fleet, number, address, drawn, cover, mayChange }) {
  const title = el("h2"), trouble = el("div"), picture = el("div", { class: "picture" }), choice = el("div", { class: "row" });
  const node = el("section", { class: "panel view" });
  const failed = (sentence) => put(trouble, note(sentence, "warn"));
  let shown = null;
  const show = (video) => {
    shown = video;
    say(title, video ? "Video" : "Drawn view");
    put(trouble);
    put(picture, video ? videoPicture(address, t`Video of tractor ${number}`, failed) : drawn, cover);
    cover.classList.toggle("band", video);
    put(choice, address && [button("Video", () => show(true), "small", { "aria-pressed": String(video) }), button("Drawn view", () => show(false), "small", { "aria-pressed": String(!video) })]);
  };
  const input = el("input", { type: "text", inputmode: "url", value: address ?? "", maxlength: "500", placeholder: "/video/1/index.m3u8", autocomplete: "off" });
  const save = button("Save", async () => {
    save.disabled = true;
    try {
      await change(`fleets/${part(fleet)}/tractors/${number}/video`, { address: input.value.trim() || null });
      location.reload(); // the page may load pictures only from addresses that were set when it was opened
    } catch (error) { failed(error.message); } finally { save.disabled = false; }
  }, "small main");
  const form = el("details", {}, el("summary", {}, "Video address"),
    labelled("Address of an MJPEG or HLS stream", input, "Browsers cannot play RTSP: let a gateway such as MediaMTX make HLS of it, and give its address. Empty means the drawn view."), el("div", { class: "row" }, save));
  put(node, title, picture, trouble, choice, form);
  show(Boolean(address));
  return { node, isDrawn: () => !shown, tell: () => { input.disabled = save.disabled = !mayChange(); } };
}
