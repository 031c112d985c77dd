// One WebSocket link to a fleet: it connects, reconnects when lost, and notices silence.
import { socketUrl, token, part } from "./api.js";

const FIRST_WAIT_MS = 400, LONGEST_WAIT_MS = 5000, SILENCE_MS = 3000;

/** Calls `heard(frame)` with every frame and `changed(state)` with connecting, online, silent or lost. */
export class Link {
  constructor(fleet, { role = "viewer", tractor = null, heard, changed = () => {} }) {
    Object.assign(this, { fleet, role, tractor, heard, changed, state: "", closed: false, wait: FIRST_WAIT_MS });
    this.watch = setInterval(() => this.listen(), 500);
    this.open();
  }

  open() {
    if (this.closed) return;
    this.tell("connecting");
    const socket = (this.socket = new WebSocket(socketUrl(`fleets/${part(this.fleet)}/link`)));
    socket.addEventListener("open", () => (this.closed ? socket.close(1000) : this.sendConnect()));
    socket.addEventListener("message", (event) => this.take(event.data));
    socket.addEventListener("close", (event) => this.lost(socket, event));
  }

  sendConnect() {
    this.last = performance.now();
    this.welcomed = false;
    this.send({ kind: "connect", role: this.role, tractor: this.tractor, token: token.get(), version: 1 });
  }

  take(data) {
    this.last = performance.now();
    let frame;
    try {
      frame = JSON.parse(data);
    } catch {
      return;
    }
    if (frame.kind === "welcome") {
      this.welcomed = true;
      this.wait = FIRST_WAIT_MS;
      this.tell("online");
    } else if (frame.kind === "refused" && !this.welcomed && this.role === "control") this.role = "viewer";
    else if (this.state === "silent") this.tell("online");
    this.heard(frame);
  }

  lost(socket, event) {
    if (socket !== this.socket || this.closed) return;
    // Without the right to control, the next attempt asks to watch only.
    if (!this.welcomed && this.role === "control" && event.code !== 1006) this.role = "viewer";
    this.tell("lost");
    this.timer = setTimeout(() => this.open(), this.wait);
    this.wait = Math.min(2 * this.wait, LONGEST_WAIT_MS);
  }

  listen() {
    if (this.state === "online" && performance.now() - this.last > SILENCE_MS) this.tell("silent");
  }

  tell(state) {
    if (state === this.state) return;
    this.state = state;
    this.changed(state);
  }

  /** Send a frame; false where there is no link to send it on (nothing is sent later: a command is for now). */
  send(frame) {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(frame));
    return true;
  }

  /** End the link. A socket that is still connecting is closed once open: browsers report an error before that. */
  close() {
    this.closed = true;
    clearInterval(this.watch);
    clearTimeout(this.timer);
    if (this.socket?.readyState !== WebSocket.CONNECTING) this.socket?.close(1000);
  }
}
