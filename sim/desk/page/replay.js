// Plays a recorded drive: `show(item, before)` is called whenever another Cab is due.
import { clamp, ticks } from "./draw.js";
import { $, fill, minutes } from "./show.js";

const PACES = [1, 2, 5, 10, 20, 60];
const STEP_S = { ArrowLeft: -10, ArrowRight: 10 };
const SAID_S = 20; // a bookmark is shown for this long at real time

export class Replay {
  constructor(drive, show) {
    this.cabs = drive.cabs;
    this.marks = drive.bookmarks;
    this.show = show;
    this.pace = 1;
    this.playing = false;
    const first_ns = this.cabs[0].cab.time_ns;
    this.times = this.cabs.map((x) => (x.cab.time_ns - first_ns) / 1e9);
    this.long = this.times.at(-1);
    $("player").hidden = false;
    $("place").max = this.long;
    $("play").onclick = () => this.toggle();
    $("pace").onclick = () => this.faster();
    $("back").onclick = () => this.jump(-1);
    $("forth").onclick = () => this.jump(1);
    $("place").oninput = () => this.go(Number($("place").value));
    this.go(drive.start_s);
  }

  speak(words) {
    const label = (id, text) => $(id).setAttribute("aria-label", text);
    this.words = words;
    label("back", words.before);
    label("forth", words.after);
    label("play", this.playing ? words.pause : words.play);
    label("place", words.place);
    label("pace", `${words.pace}: ${this.pace} ×`);
  }

  toggle() {
    if (this.now >= this.long) this.go(0);
    this.run(!this.playing);
  }

  run(on) {
    this.playing = on;
    $("play").dataset.plays = on;
    this.speak(this.words);
  }

  faster() {
    this.pace = PACES[(PACES.indexOf(this.pace) + 1) % PACES.length];
    fill($("pace"), `${this.pace} ×`);
    this.speak(this.words);
  }

  jump(way) {
    const after = this.marks.find((x) => x.at_s > this.now + 0.5);
    const before = this.marks.findLast((x) => x.at_s < this.now - 2);
    const mark = way > 0 ? after : before;
    if (mark) this.go(mark.at_s);
  }

  go(to) {
    this.now = clamp(to, 0, this.long);
    this.index = -1;
    this.tick(0);
  }

  // Advances the time (ms of the wall clock).
  tick(ms) {
    if (this.playing) {
      this.now = Math.min(this.now + Math.min(ms, 500) / 1000 * this.pace, this.long);
      if (this.now === this.long) this.run(false);
    }
    const index = Math.max(this.times.findLastIndex((s) => s <= this.now + 1e-6), 0);
    if (index !== this.index) {
      this.index = index;
      this.show(this.cabs[index], this.cabs[Math.max(index - 1, 0)]);
    }
    fill($("moment"), `${minutes(this.now)} / ${minutes(this.long)}`);
    if (document.activeElement !== $("place") || this.playing) $("place").value = this.now;
    fill($("event"), this.event());
    ticks($("marks"), this.marks.map((x) => x.at_s / this.long));
  }

  // The last bookmark passed, for a while.
  event() {
    const last = this.marks.findLast((x) => x.at_s <= this.now + 0.5);
    if (!last || this.now - last.at_s >= SAID_S * this.pace) return "";
    return last.text.startsWith(last.mark) ? last.text : `${last.mark}: ${last.text}`;
  }

  // Handles a key; returns whether the replay uses it.
  key(e) {
    if (e.code === "Space") this.toggle();
    else if (e.code in STEP_S) this.go(this.now + STEP_S[e.code]);
    else if (e.key === "[") this.jump(-1);
    else if (e.key === "]") this.jump(1);
    else if (e.code === "KeyP") this.faster();
    else return false;
    return true;
  }
}
