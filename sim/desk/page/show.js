// What a Cab says, in words and numbers. Every figure is the Cab's own, rounded for reading; nothing is guessed.
import { KMH } from "./draw.js";

export const $ = (id) => document.getElementById(id);
export const MODES = ["none", "traction", "traction", "hold", "coast", "brake", "brake", "brake", "stop", "depart"];
export const SILENCE = 1;
export const fill = (node, words) => { if (node.textContent !== words) node.textContent = words; };
export const kmh = (v) => `${Math.round(v * KMH)}`;
const big = (words) => words.charAt(0).toUpperCase() + words.slice(1);
const nice = (m, step) => Math.max(Math.round(m / step) * step, 0);
export const distance = (m, lang) => (m >= 10000 ? `${nice(m / 1000, 1)} km` : m >= 1000 ? `${(m / 1000).toLocaleString(lang, { minimumFractionDigits: 1, maximumFractionDigits: 1 })} km` : `${nice(m, m > 200 ? 50 : m > 30 ? 10 : 1)} m`);
export const span = (s) => (Math.abs(s) >= 90 ? `${Math.floor(Math.abs(s) / 60)}:${String(Math.floor(Math.abs(s) % 60)).padStart(2, "0")} min` : `${Math.round(Math.abs(s))} s`);

export class Shown {
  // `hello` is what never changes; `words` and `lang` are set by the page.
  constructor(hello) { this.hello = hello; }
  speak(words, lang) { this.W = words; this.lang = lang; }
  // The time of day on the line's clock, of a moment on the cab's clock (s).
  clock(cab, at) { return new Date(cab.time_ns / 1e6 + (at - cab.clock_s) * 1000 + this.hello.utc_offset_min * 60000).toISOString().slice(11, 19); }
  stopName(cab) { return this.hello.line.stops.find(([s]) => Math.abs(s - cab.stop_m) < 1)?.[1] ?? ""; }
  words(number, mode) { return this.hello.presentations[number].modes[this.lang][mode] ?? ""; }
  // The advice of a Cab as the card, the dial and the lever show it; null if there is none.
  advice(cab, why) {
    const kind = cab && this.hello.presentations[cab.presentation];
    if (!kind || cab.clock_s > cab.valid_until_s + 1e-9) return null;
    const mode = MODES[cab.mode] ?? "none", told = cab.display_speed_mps ?? cab.advised_speed_mps, W = this.W;
    if (kind.name === "deviation") { const s = Math.round(cab.deviation_s); return { mode: "deviation", do: s ? `${span(s)} ${s > 0 ? W.late : W.early}` : W.on_time, why: "", speed: null, effort: null, due: 0 }; }
    const stands = mode === "stop" || mode === "depart", departs = mode === "depart", speed = departs ? cab.next_speed_mps : stands ? null : told;
    const effort = stands || mode === "coast" || mode === "hold" ? null : cab.advised_lever_ratio;
    const said = effort == null ? "" : `${Math.round(Math.abs(effort) * 100)} % ${effort < 0 ? W.brake : W.power}`;
    return {
      mode: kind.highest && !stands ? "top" : mode, do: kind.highest && !stands ? W.at_most : big(this.words(cab.presentation, cab.mode)),
      why: [said, why?.[this.lang] ?? ""].filter(Boolean).join(" · "), speed: speed != null && speed > 0.5 ? speed : null, effort: mode === "coast" ? 0 : effort,
      due: cab.due_s > 0.5 ? cab.due_s - (cab.clock_s - cab.advice_s) : 0, stands,
    };
  }
  // The next changes of the advice: way (m; null: not said), time (s), mode and words.
  changes(cab, advice) {
    if (!advice || advice.stands) return [];
    const since = cab.clock_s - cab.advice_s, rolled = cab.speed_mps * since, found = [];
    const add = (number, way, time, speed, second) => {
      const mode = MODES[number]; if (!mode || mode === "none" || time == null || time - since <= 0) return;
      const at = speed != null && speed > 0.5 && mode !== "coast" ? ` ${kmh(speed)}` : "";
      found.push({ mode, second, way: way == null ? null : Math.max(way - rolled, 0), time: time - since, words: `${big(this.words(cab.presentation, number))}${at}` });
    };
    add(cab.next_mode, cab.next_change_m, cab.next_change_s, cab.next_speed_mps, false);
    add(cab.second_mode, cab.second_change_m, cab.second_change_s, cab.second_speed_mps, true);
    return found;
  }
  // The lowest of the line's limits and the temporary ones, place by place.
  allowed(cab) {
    const ahead = cab.limits_ahead.length ? cab.limits_ahead.map((x) => [x.s_m, x.limit_mps]) : this.hello.line.limits.filter(([s]) => s > cab.s_m && s < cab.stop_m);
    const line = [[cab.s_m - 1, cab.limit_mps], ...ahead], slow = this.slow(cab).map(([a, b, v]) => [a, b + this.hello.train.length_m, v]);
    const at = [...new Set([...line.map(([s]) => s), ...slow.flatMap(([a, b]) => [a, b])])].filter((s) => s >= cab.s_m - 1).sort((a, b) => a - b);
    return at.map((s) => [s, Math.min(line.filter(([x]) => x <= s + 0.01).at(-1)[1], ...slow.filter(([a, b]) => a <= s && s < b).map(([, , v]) => v))]);
  }
  slow(cab) { return cab.restrictions.map((x) => [x.start_m, x.end_m, x.limit_mps]); }
  limit(cab) { return Math.min(cab.limit_mps, ...this.slow(cab).filter(([a, b]) => a < cab.s_m && cab.s_m - this.hello.train.length_m < b).map(([, , v]) => v)); }
  efforts(v) { const { efforts_n: rows, step_mps: step } = this.hello.train; return rows[Math.min(Math.round(v / step), rows.length - 1)]; }

  // Writes the header, the card, what comes up, and the order to drive; returns what is on the card.
  write(cab, advice, wasBraked) {
    const W = this.W, left = cab.stop_m - cab.s_m, stop = this.stopName(cab), braked = cab.interlock === SILENCE, standing = cab.speed_mps < 0.05;
    fill($("stop"), stop); fill($("way"), left >= 0 ? distance(left, this.lang) : ""); fill($("clock"), this.clock(cab, cab.clock_s));
    const waits = standing && !cab.may_depart, deviates = this.hello.presentations[cab.presentation]?.name === "deviation";
    fill($("due"), waits && left > 10 ? `${W.departs} ${this.clock(cab, cab.departure_s)}` : `${W.due} ${this.clock(cab, cab.arrival_s)}`);
    const late = this.hello.punctuality && !deviates && cab.look ? cab.late_s : null;
    fill($("late"), late == null ? "" : Math.abs(late) < 10 ? W.on_time : `${span(late)} ${late > 0 ? W.late : W.early}`);
    const card = braked ? { mode: "braked", do: W.braked, why: W.braked_why, speed: null, due: 0 } : advice ?? { mode: "none", do: W.no_advice, why: W.no_advice_why, speed: null, due: 0 };
    $("advice").dataset.mode = card.mode; $("advice").dataset.due = card.due > 0.5; $("do").classList.toggle("long", card.do.length > 18);
    fill($("do"), card.do); fill($("why"), card.why); fill($("speed"), card.speed == null ? "" : kmh(card.speed));
    fill($("soon"), card.due > 0.5 ? `${W.soon} ${span(card.due)}` : card.speed == null ? "" : "km/h");
    const order = braked ? [W.braked, ""] : wasBraked ? [W.was_braked, W.was_braked_why] : waits ? [W.wait, `${W.wait_why} ${this.clock(cab, cab.departure_s)}`]
      : cab.signal_m != null && cab.signal_m > cab.s_m ? [W.signal, `${W.soon} ${distance(cab.signal_m - cab.s_m, this.lang)}`] : standing && left > 10 ? [W.depart, W.depart_why] : standing ? [W.stopped, ""] : [W.clear, ""];
    fill($("may"), order[0]); fill($("told"), order[1]);
    this.list(cab, advice, left, stop);
    Object.assign(document.body.dataset, {
      look: cab.look, speed: kmh(cab.speed_mps), limit: kmh(this.limit(cab)), advice: advice?.speed == null ? "" : kmh(advice.speed), mode: card.mode, braked,
      effort: advice?.effort == null ? "" : advice.effort.toFixed(3), way: left.toFixed(1), due: card.due.toFixed(1), may: cab.may_depart, lever: Math.round(cab.lever_ratio * 100),
    });
    return card;
  }
  list(cab, advice, left, stop) {
    const W = this.W, rows = this.changes(cab, advice).map((x) => [x.way ?? cab.speed_mps * x.time, x.words, x.way, x.time, "advised"]);
    const limits = this.allowed(cab), next = limits.find(([s, v], i) => i && s > cab.s_m && Math.abs(v - limits[i - 1][1]) > 0.1 && s < cab.stop_m);
    if (next) rows.push([next[0] - cab.s_m, `${W.limit} ${kmh(next[1])}`, next[0] - cab.s_m, null, ""]);
    if (cab.signal_m != null && cab.signal_m > cab.s_m) rows.push([cab.signal_m - cab.s_m, W.signal, cab.signal_m - cab.s_m, null, ""]);
    if (left > 0) rows.push([left, `${W.stop} ${stop}`, left, null, ""]);
    rows.sort((a, b) => a[0] - b[0]);
    const list = $("coming"), shown = rows.slice(0, 3);
    while (list.children.length > shown.length) list.lastChild.remove();
    shown.forEach(([, words, way, time, kind], i) => {
      let li = list.children[i];
      if (!li) { li = document.createElement("li"); li.append(document.createElement("b"), document.createElement("span"), document.createElement("i")); list.append(li); }
      li.className = kind; fill(li.children[0], words); fill(li.children[1], way == null ? "" : distance(way, this.lang)); fill(li.children[2], time == null ? "" : span(time));
    });
  }
}
