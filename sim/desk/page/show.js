// The content of a Cab as words and numbers. Every figure is from the Cab, rounded for reading.
import { KMH } from "./draw.js";

export const SILENCE = 1; // Cab.INTERLOCK_SILENCE: the dead-man brake
const TOO_FAST = 2; // ReasonCode.TOO_FAST
const SAME_PLACE_M = 30; // a change this close to a limit or a stop is shown at it
export const $ = (id) => document.getElementById(id);
export const fill = (node, words) => {
  if (node.textContent !== words) node.textContent = words;
};
// An element with properties, attributes (in `attr`) and children.
export function make(name, { attr = {}, ...properties } = {}, ...children) {
  const node = Object.assign(document.createElement(name), properties);
  Object.entries(attr).forEach(([key, value]) => node.setAttribute(key, value));
  node.append(...children);
  return node;
}
export const kmh = (v) => `${Math.round(v * KMH)}`;
export const minutes = (s) => `${Math.floor(s / 60)}:${String(Math.floor(s % 60)).padStart(2, "0")}`;
const big = (words) => words.charAt(0).toUpperCase() + words.slice(1);

export function distance(m, lang) {
  if (m >= 10000) return `${Math.round(m / 1000)} km`;
  const digits = { minimumFractionDigits: 1, maximumFractionDigits: 1 };
  if (m >= 1000) return `${(m / 1000).toLocaleString(lang, digits)} km`;
  const step = m > 200 ? 50 : m > 30 ? 10 : 1;
  return `${Math.max(Math.round(m / step) * step, 0)} m`;
}

export function span(s) {
  const long = Math.abs(s);
  return long >= 90 ? `${minutes(long)} min` : `${Math.round(long)} s`;
}

export class Shown {
  // `hello` is the constant data of the page.
  constructor(hello) {
    this.hello = hello;
  }

  // Sets the language: the page's words, and the words of the advice.
  speak(words, lang) {
    this.words = words;
    this.lang = lang;
    this.advised = this.hello.words[lang];
  }

  // The time of day on the line's clock for a time on the cab's clock (s).
  clock(cab, at_s) {
    const utc_ms = cab.time_ns / 1e6 + (at_s - cab.clock_s) * 1000;
    return new Date(utc_ms + this.hello.utc_offset_min * 60000).toISOString().slice(11, 19);
  }

  stopName(cab) {
    return this.hello.line.stops.find(([s]) => Math.abs(s - cab.stop_m) < 1)?.[1] ?? "";
  }

  presentation(cab) {
    return this.hello.presentations[cab.presentation];
  }

  // The words for a mode; `speed` (m/s): the speed that follows them, if any.
  modeWords(cab, mode, speed) {
    const { modes, before_speed } = this.presentation(cab);
    return big((speed > 0.5 ? before_speed : modes)[this.lang][mode] ?? "");
  }

  // The delay of a train (early < 0) as text.
  lateness(s) {
    return (s > 0 ? this.advised.late : this.advised.early).replace("{seconds} s", span(s));
  }

  // The advice of a Cab as the card, the dial and the lever show it; null if there is none.
  advice(cab, why) {
    const presentation = this.presentation(cab);
    if (!presentation || cab.clock_s > cab.valid_until_s + 1e-9) return null;
    if (presentation.lateness) {
      const late_s = Math.round(cab.deviation_s);
      const said = late_s ? this.lateness(late_s) : this.advised.on_time;
      return { mode: "lateness", do: said, why: "", speed: null, effort: null, due: 0 };
    }
    const kind = this.hello.kinds[cab.mode] ?? "none", stands = kind === "stop" || kind === "depart";
    let speed = cab.display_speed_mps ?? cab.advised_speed_mps;
    if (stands) speed = kind === "depart" ? cab.next_speed_mps : null;
    const effort = stands || kind === "coast" || kind === "hold" ? null : cab.advised_lever_ratio;
    const top = presentation.highest && !stands, slower = kind === "hold" && cab.reason.code === TOO_FAST;
    return {
      mode: top ? "top" : kind,
      sign: slower ? "brake" : null,
      do: top ? this.words.at_most : slower ? this.words.slow_to : this.modeWords(cab, cab.mode, speed),
      why: [this.effort(effort), why?.[this.lang]].filter(Boolean).join(" · "),
      speed: speed > 0.5 ? speed : null,
      effort: kind === "coast" ? 0 : effort,
      due: cab.due_s > 0.5 ? cab.due_s - (cab.clock_s - cab.advice_s) : 0,
      stands,
    };
  }

  effort(ratio) {
    if (ratio == null) return "";
    return `${Math.round(Math.abs(ratio) * 100)} % ${ratio < 0 ? this.words.brake : this.words.power}`;
  }

  // The next changes of the advice: distance (m; null: not shown), time (s), mode and words.
  changes(cab, advice) {
    if (!advice || advice.stands) return [];
    const since_s = cab.clock_s - cab.advice_s, rolled_m = cab.speed_mps * since_s;
    return ["next", "second"].flatMap((which) => {
      const mode = cab[`${which}_mode`], kind = this.hello.kinds[mode] ?? "none", speed = cab[`${which}_speed_mps`];
      const way = cab[`${which}_change_m`], time = cab[`${which}_change_s`];
      if (kind === "none" || time == null || time <= since_s) return [];
      const reached = speed > 0.5 && kind !== "coast" ? ` ${kmh(speed)}` : "";
      // An acceleration that only changes its effort shows the new one.
      const effort = cab[`${which}_effort_ratio`], eases = kind === "traction" && kind === advice.mode;
      const share = eases && effort != null && kmh(speed) === kmh(advice.speed)
        ? ` · ${Math.round(100 * effort)} %`
        : "";
      return [{
        mode: kind,
        second: which === "second",
        way: way == null ? null : Math.max(way - rolled_m, 0),
        time: time - since_s,
        words: `${this.modeWords(cab, mode)}${reached}${share}`,
      }];
    });
  }

  // The lowest of the line's limits and the temporary ones at each place.
  allowed(cab) {
    const told = cab.limits_ahead.map((x) => [x.s_m, x.limit_mps]);
    const known = this.hello.line.limits.filter(([s]) => s > cab.s_m && s < cab.stop_m);
    const here_m = cab.s_m - 1, line = [[here_m, cab.limit_mps], ...(told.length ? told : known)];
    const slow = this.slow(cab).map(([from, to, v]) => [from, to + this.hello.train.length_m, v]);
    const places = [...line.map(([s]) => s), ...slow.flatMap(([from, to]) => [from, to])];
    const ahead = [...new Set(places)].filter((s) => s >= here_m).sort((a, b) => a - b);
    return ahead.map((s) => {
      const limit = line.findLast(([from]) => from <= s + 0.01)[1];
      const temporary = slow.filter(([from, to]) => from <= s && s < to).map(([, , v]) => v);
      return [s, Math.min(limit, ...temporary)];
    });
  }

  // The restrictions: start and end (m), and speed.
  slow(cab) {
    return cab.restrictions.map((x) => [x.start_m, x.end_m, x.limit_mps]);
  }

  // The limit for the whole train at its position.
  limit(cab) {
    const rear_m = cab.s_m - this.hello.train.length_m;
    const under = this.slow(cab).filter(([from, to]) => from < cab.s_m && rear_m < to);
    return Math.min(cab.limit_mps, ...under.map(([, , v]) => v));
  }

  // Whether the train is too fast for the limit; called once for each Cab, because it depends on the one before.
  tooFast(cab) {
    const [begins_mps, ends_mps] = this.hello.too_fast_mps;
    this.over = cab.speed_mps - this.limit(cab) > (this.over ? ends_mps : begins_mps);
    return this.over;
  }

  efforts(v) {
    const { efforts_n: rows, step_mps: step } = this.hello.train;
    return rows[Math.min(Math.round(v / step), rows.length - 1)];
  }

  // Writes the header, the card, the list of what comes next, and the order to drive; returns the content of the card.
  write(cab, advice, wasBraked) {
    const braked = cab.interlock === SILENCE, card = this.card(advice, braked), over = this.tooFast(cab);
    this.header(cab);
    $("advice").dataset.mode = card.mode;
    $("advice").dataset.due = card.due > 0.5;
    $("do").classList.toggle("long", card.do.length > 18);
    fill($("do"), card.do);
    fill($("why"), card.why);
    fill($("speed"), card.speed == null ? "" : kmh(card.speed));
    fill($("soon"), card.due > 0.5 ? `${this.words.soon} ${span(card.due)}` : card.speed == null ? "" : "km/h");
    const [may, told] = this.order(cab, braked, wasBraked);
    fill($("may"), may);
    fill($("told"), told);
    this.list(this.coming(cab, advice).slice(0, 3));
    Object.assign(document.body.dataset, {
      look: cab.look,
      speed: kmh(cab.speed_mps),
      limit: kmh(this.limit(cab)),
      advice: advice?.speed == null ? "" : kmh(advice.speed),
      mode: card.mode,
      braked,
      over,
      effort: advice?.effort == null ? "" : advice.effort.toFixed(3),
      way: (cab.stop_m - cab.s_m).toFixed(1),
      due: card.due.toFixed(1),
      may: cab.may_depart,
      lever: Math.round(cab.lever_ratio * 100),
    });
    return card;
  }

  card(advice, braked) {
    const words = this.words, bare = { speed: null, due: 0 };
    if (braked) return { ...bare, mode: "braked", do: words.braked, why: words.braked_why };
    return advice ?? { ...bare, mode: "none", do: big(this.advised.no_advice), why: words.no_advice_why };
  }

  // Whether the train stands before its stop, and whether it must wait before leaving.
  standing(cab) {
    const stands = cab.speed_mps < 0.05;
    return { stands, before: cab.stop_m - cab.s_m > this.hello.at_stop_m, waits: stands && !cab.may_depart };
  }

  header(cab) {
    const left = cab.stop_m - cab.s_m, { before, waits } = this.standing(cab);
    const [word, at_s] = waits && before ? [this.words.departs, cab.departure_s] : [this.words.due, cab.arrival_s];
    const hidden = !this.hello.punctuality || this.presentation(cab)?.lateness || !cab.look;
    const late = Math.abs(cab.late_s) < 10 ? this.advised.on_time : this.lateness(cab.late_s);
    fill($("stop"), this.stopName(cab));
    fill($("way"), left >= 0 ? distance(left, this.lang) : "");
    fill($("clock"), this.clock(cab, cab.clock_s));
    fill($("due"), `${word} ${this.clock(cab, at_s)}`);
    fill($("late"), hidden || cab.late_s == null ? "" : late);
  }

  // Whether the train may drive, and why.
  order(cab, braked, wasBraked) {
    const words = this.words, { stands, before, waits } = this.standing(cab), signal_m = cab.signal_m - cab.s_m;
    if (braked) return [words.braked, ""];
    if (wasBraked) return [words.was_braked, words.was_braked_why];
    if (waits) {
      return [words.wait, `${this.hello.watched ? words.departs : words.wait_why} ${this.clock(cab, cab.departure_s)}`];
    }
    if (cab.signal_m != null && signal_m > 0) return [words.signal, `${words.soon} ${distance(signal_m, this.lang)}`];
    if (this.over) return [words.too_fast, `${words.limit} ${kmh(this.limit(cab))} km/h`];
    if (stands && !before) return [words.stopped, ""];
    const { at_stop_m, line, train, watched } = this.hello;
    if (watched) return ["", ""]; // signals and doors are not on the bus
    const called = line.stops.some(([s]) => s - at_stop_m <= cab.s_m && cab.s_m < s + train.length_m);
    return stands && called ? [words.depart, words.depart_why] : [words.clear, ""];
  }

  // The coming items, nearest first: distance (m), words, whether the distance is shown, and for advice the
  // time until then (s).
  coming(cab, advice) {
    const rows = this.changes(cab, advice).map(({ way, time, words }) => {
      return { at: way ?? cab.speed_mps * time, words, said: way != null, time };
    });
    const add = (s, words) => {
      if (s > cab.s_m) rows.push({ at: s - cab.s_m, words, said: true });
    };
    const limits = this.allowed(cab), differs = (v, i) => i && Math.abs(v - limits[i - 1][1]) > 0.1;
    const next = limits.find(([s, v], i) => differs(v, i) && s > cab.s_m && s < cab.stop_m);
    if (next) add(next[0], `${this.words.limit} ${kmh(next[1])}`);
    add(cab.signal_m ?? -Infinity, this.words.signal);
    add(cab.stop_m, `${this.words.stop} ${this.stopName(cab)}`);
    const [changes, places] = [rows.filter((row) => row.time != null), rows.filter((row) => row.time == null)];
    for (const row of changes) {
      const away = (place) => Math.abs(place.at - row.at), near = places.filter((place) => away(place) < SAME_PLACE_M);
      row.at = near.sort((a, b) => away(a) - away(b))[0]?.at ?? row.at;
    }
    return rows.sort((a, b) => a.at - b.at);
  }

  list(rows) {
    const list = $("coming");
    while (list.children.length > rows.length) list.lastChild.remove();
    while (list.children.length < rows.length) list.append(make("li", {}, make("b"), make("span"), make("i")));
    rows.forEach(({ at, words, said, time }, i) => {
      const [name, way, when] = list.children[i].children;
      list.children[i].className = time == null ? "" : "advised";
      fill(name, words);
      fill(way, said ? distance(at, this.lang) : "");
      fill(when, time == null ? "" : minutes(time));
    });
  }
}
