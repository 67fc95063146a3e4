// Plays a recorded drive: `show(item)` is called whenever another Cab is due.
import { ticks } from "./draw.js";
import { $, fill } from "./show.js";

const PACES = [1, 2, 5, 10, 20, 60];

export class Replay {
  constructor(drive, show) {
    this.cabs = drive.cabs; this.marks = drive.bookmarks; this.show = show; this.pace = 1; this.playing = false; this.index = -1;
    this.zero = this.cabs[0].cab.time_ns; this.times = this.cabs.map((x) => (x.cab.time_ns - this.zero) / 1e9); this.long = this.times.at(-1); this.now = drive.start_s;
    $("player").hidden = false; $("place").max = this.long;
    $("play").onclick = () => this.toggle(); $("pace").onclick = () => this.faster(); $("back").onclick = () => this.jump(-1); $("forth").onclick = () => this.jump(1);
    $("place").oninput = () => this.go(Number($("place").value));
    this.go(this.now);
  }
  speak(W) { for (const [id, word] of [["back", "before"], ["forth", "after"], ["play", this.playing ? "pause" : "play"], ["place", "place"]]) $(id).setAttribute("aria-label", W[word]); $("pace").setAttribute("aria-label", `${W.pace}: ${this.pace} ×`); this.W = W; }
  toggle() { if (this.now >= this.long) this.go(0); this.run(!this.playing); }
  run(on) { this.playing = on; $("play").dataset.plays = on; this.speak(this.W); }
  faster() { this.pace = PACES[(PACES.indexOf(this.pace) + 1) % PACES.length]; fill($("pace"), `${this.pace} ×`); this.speak(this.W); }
  jump(way) { const at = way > 0 ? this.marks.find((x) => x.at_s > this.now + 0.5) : this.marks.findLast((x) => x.at_s < this.now - 2); if (at) this.go(at.at_s); }
  go(to) { this.now = Math.min(Math.max(to, 0), this.long); this.index = -1; this.tick(0); }
  // Lets time pass (ms of the wall clock).
  tick(ms) {
    if (this.playing) { this.now += Math.min(ms, 500) / 1000 * this.pace; if (this.now >= this.long) { this.now = this.long; this.run(false); } }
    let low = 0, high = this.times.length - 1;
    while (low < high) { const mid = (low + high + 1) >> 1; if (this.times[mid] <= this.now + 1e-6) low = mid; else high = mid - 1; }
    if (low !== this.index) { this.index = low; this.show(this.cabs[low], this.cabs[Math.max(low - 1, 0)]); }
    const clock = (s) => `${Math.floor(s / 60)}:${String(Math.floor(s % 60)).padStart(2, "0")}`;
    fill($("moment"), `${clock(this.now)} / ${clock(this.long)}`); if (document.activeElement !== $("place") || this.playing) $("place").value = this.now;
    const last = this.marks.findLast((x) => x.at_s <= this.now + 0.5); fill($("event"), last && this.now - last.at_s < 20 * Math.max(this.pace, 1) ? (last.text.startsWith(last.mark) ? last.text : `${last.mark}: ${last.text}`) : "");
    ticks($("marks"), this.marks.map((x) => x.at_s / this.long));
  }
  key(e) {
    const to = { ArrowLeft: -10, ArrowRight: 10 }[e.code];
    if (e.code === "Space") this.toggle(); else if (to) this.go(this.now + to); else if (e.key === "[") this.jump(-1); else if (e.key === "]") this.jump(1); else if (e.code === "KeyP") this.faster(); else return false;
    return true;
  }
}
