// A session of an experiment on the veil: its steps, the answers of the participant, and the end that is always open.
import { $, fill, make, minutes } from "./show.js";

const SETTLES_MS = 600; // a text is sent when its writer pauses for this long
const ASKED_MS = 2000; // a second press within this time does not ask for another step
const MOST_RADIOS = 11; // a scale with more values is a slider
const KEYS = { KeyV: "pedal", KeyD: "detection" };

export class Session {
  // `send(message)` sends to the server if the connection is open; `wall(stamp)` is the wall clock (ms).
  constructor(send, wall) {
    this.send = send;
    this.now = () => wall(performance.now());
    this.step = null;
    this.answers = {};
    this.requests = {};
    this.stopping = false;
    document.querySelectorAll(".quit").forEach((one) => {
      one.hidden = false;
      one.onclick = () => $("really").showModal();
    });
    $("stay").onclick = () => $("really").close();
    $("leave").onclick = () => this.stop();
    $("no").onclick = () => this.consent("no");
    $("tasks").onpointerdown = (e) => this.act(e.target.closest("button")?.id, e.timeStamp, 0);
    addEventListener("pagehide", () => this.flush());
  }

  get ended() {
    return this.step?.kind === "end";
  }

  // Takes a step of the server. `fresh`: the first on a connection, so that lost answers must be sent again.
  take(m, fresh) {
    const same = m.id === this.step?.id;
    if (!same) this.leave();
    const mine = this.answers, given = m.given ?? {};
    this.step = m;
    this.until = performance.now() + 1000 * (m.wait_s ?? 0);
    this.answers = { ...given, ...mine };
    if (fresh) {
      this.askedAt = -Infinity;
      if (this.stopping && !this.ended) this.stop();
      Object.entries(mine).forEach(([item, value]) => given[item] !== value && this.answer(item, value));
    }
    if (same) return;
    this.drawn = "";
    this.askedAt = -Infinity;
  }

  // Leaves the present step: its last words are sent.
  leave() {
    if (!this.step) return;
    this.flush();
    this.step = null;
    this.answers = {};
    ["progress", "prose", "items", "trouble"].forEach((id) => $(id).replaceChildren());
    $("no").hidden = true;
    $("really").close();
  }

  answer(item, value) {
    this.answers[item] = value;
    this.fault(item, "");
    this.send({ t: "answer", step: this.step.id, item, value, at: this.now() });
  }

  // Sends a text that is still being written.
  flush() {
    if (!this.writing) return;
    clearTimeout(this.writing.timer);
    const { item, node } = this.writing;
    this.writing = null;
    if (this.answers[item] !== node.value) this.answer(item, node.value);
  }

  consent(value) {
    this.answer("consent", value);
    this.next();
  }

  next() {
    if (!this.step || performance.now() - this.askedAt < ASKED_MS) return;
    this.flush();
    const missing = (this.step.items ?? []).filter((one) => one.needed && !this.answers[one.id]?.trim());
    missing.forEach((one) => this.fault(one.id, one.kind === "text" ? this.words.write : this.words.choose));
    if (missing.length) {
      document.querySelector(`[data-item="${missing[0].id}"] :is(input, textarea)`).focus();
      return;
    }
    this.askedAt = performance.now();
    this.send({ t: "next", step: this.step.id, at: this.now() });
  }

  stop() {
    $("really").close();
    this.flush();
    this.stopping = true;
    this.send({ t: "stop", at: this.now() });
  }

  // Writes what is wrong with an answer beside its item.
  fault(item, words) {
    const box = document.querySelector(`[data-item="${item}"]`);
    if (!box) return;
    fill(box.lastChild, words);
    box.toggleAttribute("data-fault", words !== "");
  }

  // ---- the veil
  // Writes the step in the page's language; `lost`: there is no connection. `keys(tasks)` lists the desk's keys.
  draw(words, lost, keys) {
    const { step } = this;
    this.words = words;
    if (!step) return;
    fill($("trouble"), lost && !this.ended ? words.lost_kept : "");
    if (this.drawn === words.name) return;
    this.drawn = words.name;
    fill($("progress"), this.progress());
    fill($("title"), step.title || (words[`step_${step.about}`] ?? ""));
    fill($("text"), { ready: words.signs, end: words.goodbye }[step.kind] ?? "");
    $("prose").innerHTML = step.html ?? ""; // the only markup from outside the page: rendered by the server, without HTML
    $("items").replaceChildren(...(step.items ?? []).map((one) => this.item(one)));
    $("keys").replaceChildren(...(step.kind === "ready" ? keys(step.tasks ?? []) : []));
    fill($("go"), { ready: words.ready, consent: words.agree }[step.kind] ?? words.next);
    $("no").hidden = step.kind !== "consent";
    document.querySelectorAll(".quit").forEach((one) => one.hidden = this.ended || this.stopping);
    this.tick();
    $("veil").firstElementChild.scrollTop = 0;
    $("title").focus({ focusVisible: false });
  }

  progress() {
    const { done = 0, of = 0, kind } = this.step;
    if (!of || kind === "end") return "";
    const words = kind === "ready" ? this.words.trial : this.words.trials_done;
    return words.replace("{n}", kind === "ready" ? Math.min(done + 1, of) : done).replace("{m}", of);
  }

  // Counts a break down; called in every frame.
  tick() {
    if (!this.step || !this.words) return;
    const left_s = Math.ceil((this.until - performance.now()) / 1000);
    $("go").hidden = this.ended || left_s > 0;
    const box = $("veil").firstElementChild;
    box.toggleAttribute("data-more", box.scrollHeight - box.clientHeight - box.scrollTop > 8);
    if (this.step.kind === "break" || left_s > 0) {
      fill($("text"), left_s > 0 ? this.words.break_left.replace("{m}", minutes(left_s)) : this.words.break_over);
    }
  }

  item(one) {
    const { kind, id } = one, values = (one.most - one.least) / one.step + 1;
    const field = kind === "text"
      ? this.text(one)
      : kind === "choice"
      ? this.radios(one, one.options.map((words, i) => [`${i + 1}`, words]))
      : values > MOST_RADIOS
      ? this.slider(one)
      : this.radios(one, Array.from({ length: values }, (_, i) => Array(2).fill(`${one.least + i * one.step}`)));
    const ends = make(
      "div",
      { className: "ends", id: `ends-${id}` },
      make("span", {}, one.low),
      make("span", {}, one.high),
    );
    const fault = make("p", { className: "fault", id: `fault-${id}`, attr: { role: "alert" } });
    const optional = one.needed ? [] : [make("i", {}, ` (${this.words.optional})`)];
    return make(
      "fieldset",
      { className: `item ${kind}`, attr: { "data-item": id, "aria-describedby": `ends-${id} fault-${id}` } },
      make("legend", {}, one.text, ...optional),
      field,
      ...(one.low || one.high ? [ends] : []),
      fault,
    );
  }

  radios({ id }, rows) {
    const label = ([value, words]) => {
      const box = make("input", { type: "radio", name: id, value, checked: this.answers[id] === value });
      box.oninput = () => this.answer(id, value);
      return make("label", {}, box, make("span", {}, words));
    };
    return make("div", { className: "radios" }, ...rows.map(label));
  }

  // A slider has no thumb before its first answer, so that its resting place suggests none.
  slider({ id, least, most, step, text, low, high }) {
    const given = this.answers[id], middle = least + step * Math.floor((most - least) / step / 2);
    const attr = {
      "aria-label": `${text} ${low} – ${high}`,
      "data-set": given != null,
      "aria-valuetext": given ?? "–",
    };
    const box = make("input", { type: "range", min: least, max: most, step, value: given ?? middle, attr });
    const shown = make("output", {}, given ?? "–");
    const set = () => {
      if (this.answers[id] === box.value) return;
      box.dataset.set = true;
      box.setAttribute("aria-valuetext", box.value);
      fill(shown, box.value);
      this.answer(id, box.value);
    };
    box.oninput = box.onclick = set;
    box.onkeydown = (e) => {
      if (e.code === "Enter" || e.code === "Space") set();
    };
    return make("div", { className: "slider" }, box, shown);
  }

  text({ id, text }) {
    const node = make("textarea", {
      rows: 3,
      maxLength: 500,
      value: this.answers[id] ?? "",
      attr: { "aria-label": text },
    });
    node.oninput = () => {
      clearTimeout(this.writing?.timer);
      this.writing = { item: id, node, timer: setTimeout(() => this.flush(), SETTLES_MS) };
    };
    node.onblur = () => this.flush();
    return node;
  }

  // ---- tasks beside driving
  // Shows or removes the request of a task.
  task({ what, number, on }) {
    $(what).hidden = !on;
    if (on) requestAnimationFrame((stamp) => this.requests[what] = { number, shown: performance.timeOrigin + stamp });
  }

  clear() {
    Object.values(KEYS).forEach((what) => $(what).hidden = true);
  }

  // Handles a key of a task; returns whether it is one.
  key(e, look) {
    if (KEYS[e.code]) this.act(KEYS[e.code], e.timeStamp, look);
    return e.code in KEYS;
  }

  act(what, stamp, look) {
    if (!what) return;
    $(what).hidden = true;
    this.send({ t: "act", what, at: performance.timeOrigin + stamp, look, ...this.requests[what] });
  }
}
