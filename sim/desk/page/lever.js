// The person's hand: keyboard, mouse, touch, wheel and gamepad move one lever. `give(ratio, stamp, device)` is told where to.
const UP = { ArrowUp: 1, KeyW: 1, ArrowDown: -1, KeyS: -1 }, AGAIN_MS = 120, FIRST_MS = 380, TREMBLE = 0.06, MOVED = 0.03;

export class Lever {
  constructor(node, give) {
    this.node = node; this.give = give; this.ratio = 0; this.notches = 10; this.active = false; this.held = {}; this.axis = null;
    node.addEventListener("pointerdown", (e) => { node.setPointerCapture(e.pointerId); this.grab(e); });
    node.addEventListener("pointermove", (e) => { if (e.buttons) this.grab(e); });
    node.addEventListener("wheel", (e) => { e.preventDefault(); this.step(e.deltaY < 0 ? 1 : -1, e.timeStamp, "wheel"); }, { passive: false });
    addEventListener("keyup", (e) => this.free(e.code));
    addEventListener("blur", () => Object.keys(this.held).forEach((code) => this.free(code)));
  }
  get notch() { return 1 / (this.notches || 20); }
  place(ratio) { this.ratio = ratio; const percent = Math.round(ratio * 100); this.node.setAttribute("aria-valuenow", percent); return percent; }
  set(to, stamp, device) {
    to = Math.min(Math.max(Math.round(to * 1000) / 1000, -1), 1);
    if (!this.active || to === this.ratio) return;
    this.place(to); this.give(to, stamp, device);
  }
  // A step rests at 0: to pass it takes another press.
  step(way, stamp, device) {
    const from = this.ratio / this.notch, to = way > 0 ? Math.floor(from + 1e-6) + 1 : Math.ceil(from - 1e-6) - 1;
    this.set(to * this.notch, stamp, device);
  }
  // Takes a key; returns whether it was one of the lever's.
  key(e) {
    const way = UP[e.code];
    if (way) {
      if (e.repeat || this.held[e.code]) return true;
      this.step(way, e.timeStamp, "key");
      const again = () => { if (!this.held[e.code]) return; if (this.ratio !== 0) this.step(way, performance.now(), "key-held"); this.held[e.code] = setTimeout(again, AGAIN_MS); };
      this.held[e.code] = setTimeout(again, FIRST_MS);
    } else if (e.code === "Digit0" || e.code === "Numpad0" || e.key === "0") this.set(0, e.timeStamp, "key");
    else if (e.code === "End") this.set(-1, e.timeStamp, "key");
    else return false;
    return true;
  }
  free(code) { clearTimeout(this.held[code]); delete this.held[code]; }
  grab(e) {
    const b = this.node.getBoundingClientRect(), q = 1 - 2 * (e.clientY - b.top - 56) / (b.height - 112), n = this.notches ? this.notch : 0.01;
    this.set(Math.round(Math.min(Math.max(q, -1), 1) / n) * n, e.timeStamp, e.pointerType === "mouse" ? "mouse" : e.pointerType);
  }
  // A gamepad's stick moves the lever only while it moves by more than a tremble: at rest, it leaves the keys in charge.
  pad(now) {
    const one = navigator.getGamepads?.().find((p) => p?.connected); if (!one) { this.axis = null; return; }
    const raw = -one.axes[1], q = Math.abs(raw) < TREMBLE ? 0 : raw, n = this.notches ? this.notch : 0.01;
    if (this.axis === null) { this.axis = q; return; }
    if (Math.abs(q - this.axis) > MOVED || (q === 0 && this.axis !== 0)) { this.set(Math.round(q / n) * n, now, "gamepad"); this.axis = q; }
  }
}
