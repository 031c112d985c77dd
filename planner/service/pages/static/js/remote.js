// The panel of remote control: lease with takeover, dead-man switch, speed limit, and the commands while it is held.
import { el, put, say, button } from "./dom.js";
import { t, translate } from "./language.js";
import { Hands, commandOf } from "./control.js";
import { kmh } from "./words.js";

const SEND_MS = 100, REPEAT_STILL = 3, STEERING_DEG = 30, FASTEST_MPS = 5 / 3.6;

export function remotePanel(live, number) {
  const fastest = () => live.settings.remote_mps ?? FASTEST_MPS;
  const fullLock = () => live.scene?.machines[number - 1]?.max_steering_deg ?? STEERING_DEG;
  const holder = el("p", { class: "small", role: "status" }), dead = el("div", { class: "dead" }), now = el("p", { class: "small soft num" });
  const action = el("span", { class: "action" });
  const label = (side, words) => el("span", { class: `label ${side}` }, words);
  const pad = el("div", { class: "pad", role: "group", "aria-label": "Touch to drive: up is forwards, the sides steer; release to stop" },
    label("n", "forwards"), label("s", "back"), label("w", "left"), label("e", "right"), action);
  const limit = el("input", { type: "range", min: "10", max: "100", step: "5", value: "40", "aria-label": "Speed limit" }), limitText = el("output");
  const lease = () => live.lease(number), mine = () => Boolean(lease().is_yours);
  const surface = el("div", { class: "panel stack", tabindex: "0", role: "region", "aria-label": "Remote control" });
  const hands = new Hands({ surface, pad, ready: mine });
  const take = button("Take control", () => live.send({ kind: "lease", tractor: number, takeover: false }), "main");
  const over = button("Take over", () => live.send({ kind: "lease", tractor: number, takeover: true }), "danger");
  const leave = button("Give back", () => live.send({ kind: "leave", tractor: number }));
  const resume = button("Resume its plan", () => live.send({ kind: "resume", tractor: number }));
  put(surface, el("h2", {}, "Remote control"), holder, el("div", { class: "row leases" }, take, over, leave, resume), dead, pad,
    el("label", {}, el("span", { class: "name" }, "Speed limit ", limitText), limit), now,
    el("p", { class: "small soft keys" }, "Keys: hold ", el("kbd", {}, "Space"), " and steer with the arrows. Gamepad: hold a shoulder button; left stick steers, triggers drive. Touch: the disc. Releasing stops the tractor."));
  let still = REPEAT_STILL;
  const send = () => {
    if (!mine()) return;
    const share = hands.read(), command = commandOf(share, { limit_mps: (limit.value / 100) * fastest(), steering_deg: fullLock() });
    still = share.held ? 0 : still + 1;
    // After release a few frames say stop, in case one is lost; then silence, which means the same.
    const stamp = still <= REPEAT_STILL && live.stamp.next();
    if (stamp) live.send({ kind: "command", ...stamp, tractor: number, ...command });
    dead.classList.toggle("held", share.held);
    say(dead, share.held ? t`Driving by ${translate(share.by)}` : "Released: it stands");
    const far = Math.max(1, Math.hypot(share.steering, share.speed));
    action.style.setProperty("--x", String(share.steering / far));
    action.style.setProperty("--y", String(-share.speed / far));
    say(now, t`${kmh(command.speed_command_mps)} ${translate(command.shuttle < 0 ? "back" : "forwards")}, wheels ${Math.abs(command.steering_command_deg).toFixed(0)}\u00B0 ${translate(command.steering_command_deg < 0 ? "left" : "right")}`);
  };
  let had = false;
  const tell = () => {
    const one = lease(), other = Boolean(one.holder) && !one.is_yours;
    if (mine() && !had) surface.focus({ preventScroll: true });
    had = mine();
    take.hidden = mine() || other;
    over.hidden = !other;
    leave.hidden = !mine();
    resume.hidden = mine() || live.fixes.get(number)?.mode === "automatic";
    for (const each of [take, over, resume]) each.disabled = !live.mayControl;
    pad.setAttribute("aria-disabled", String(!mine()));
    dead.hidden = now.hidden = !mine();
    say(limitText, `${kmh((limit.value / 100) * fastest())}`);
    say(holder, !live.mayControl ? "You can watch this tractor. Driving it needs an operator\u2019s token; enter one under Access." : mine() ? "You drive this tractor; nobody else can."
      : other ? t`${one.holder} drives this tractor. Taking over is shown to both of you.` : "Nobody drives this tractor by hand.");
  };
  const sending = setInterval(send, SEND_MS);
  tell();
  return { node: surface, tell, isMine: mine, close: () => { clearInterval(sending); hands.close(); if (mine()) live.send({ kind: "leave", tractor: number }); } };
}
