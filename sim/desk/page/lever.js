// The person's hand: keyboard, mouse, touch, wheel and gamepad move one lever; `give(ratio, stamp, device)` is
// called with its setting.
import { clamp } from "./draw.js";

const UP = { ArrowUp: 1, KeyW: 1, ArrowDown: -1, KeyS: -1 };
const FIRST_MS = 380, AGAIN_MS = 120; // a key that is held down repeats
const TREMBLE = 0.06, MOVED = 0.03; // of a gamepad's stick, as shares of its range
const MARGIN_PX = 56; // above and below the lever's groove

export class Lever {
  constructor(node, give) {
    this.node = node;
    this.give = give;
    this.ratio = 0;
    this.notches = 10;
    this.active = false;
    this.held = {};
    this.axis = null;
    node.addEventListener("pointerdown", (e) => {
      node.setPointerCapture(e.pointerId);
      this.grab(e);
    });
    node.addEventListener("pointermove", (e) => {
      if (e.buttons) this.grab(e);
    });
    node.addEventListener("wheel", (e) => {
      e.preventDefault();
      this.step(e.deltaY < 0 ? 1 : -1, e.timeStamp, "wheel");
    }, { passive: false });
    addEventListener("keyup", (e) => this.free(e.code));
    addEventListener("blur", () => Object.keys(this.held).forEach((code) => this.free(code)));
  }

  place(ratio) {
    this.ratio = ratio;
    this.node.setAttribute("aria-valuenow", Math.round(ratio * 100));
  }

  set(to, stamp, device) {
    to = clamp(Math.round(to * 1000) / 1000, -1, 1);
    if (!this.active || to === this.ratio) return;
    this.place(to);
    this.give(to, stamp, device);
  }

  // Sets the lever to the notch nearest to a place; without notches, to a whole percent.
  near(ratio, stamp, device) {
    const notches = this.notches || 100;
    this.set(Math.round(clamp(ratio, -1, 1) * notches) / notches, stamp, device);
  }

  // Moves by a notch, or by a twentieth without notches. A step stops at 0; another press passes it.
  step(way, stamp, device) {
    const notches = this.notches || 20, from = this.ratio * notches;
    const to = way > 0 ? Math.floor(from + 1e-6) + 1 : Math.ceil(from - 1e-6) - 1;
    this.set(to / notches, stamp, device);
  }

  // Handles a key; returns whether the lever uses it.
  key(e) {
    if (UP[e.code]) this.press(e, UP[e.code]);
    else if (e.code === "Digit0" || e.code === "Numpad0" || e.key === "0") this.set(0, e.timeStamp, "key");
    else if (e.code === "End") this.set(-1, e.timeStamp, "key");
    else return false;
    return true;
  }

  press(e, way) {
    if (e.repeat || this.held[e.code]) return;
    this.step(way, e.timeStamp, "key");
    const again = () => {
      if (this.ratio !== 0) this.step(way, performance.now(), "key-held");
      this.held[e.code] = setTimeout(again, AGAIN_MS);
    };
    this.held[e.code] = setTimeout(again, FIRST_MS);
  }

  free(code) {
    clearTimeout(this.held[code]);
    delete this.held[code];
  }

  grab(e) {
    const box = this.node.getBoundingClientRect();
    const share = (e.clientY - box.top - MARGIN_PX) / (box.height - 2 * MARGIN_PX);
    this.near(1 - 2 * share, e.timeStamp, e.pointerType);
  }

  // A gamepad's stick moves the lever only while it moves by more than a tremble; at rest, the keys control it.
  pad(now) {
    const pad = navigator.getGamepads?.().find((one) => one?.connected);
    const raw = pad ? -pad.axes[1] : null, axis = Math.abs(raw) < TREMBLE ? 0 : raw;
    const before = this.axis, rests = pad && before !== null && Math.abs(axis - before) <= MOVED;
    if (rests && (axis !== 0 || before === 0)) return;
    this.axis = pad ? axis : null;
    if (pad && before !== null) this.near(axis, now, "gamepad");
  }
}
