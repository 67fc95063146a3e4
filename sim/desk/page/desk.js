// The cab desk: shows the last Cab and sends the setting of the lever. Its only own state is zoom, sound and
// language.
import * as draw from "./draw.js";
import { Lever } from "./lever.js";
import { Replay } from "./replay.js";
import { Session } from "./session.js";
import { $, distance, fill, kmh, make, Shown, SILENCE } from "./show.js";
import { LANGUAGES, WORDS } from "./words.js";

const STALE_MS = 1500; // a link silent for this long counts as lost, and its advice with it
const DRAWN_MS = 400; // the page reports its frames to the desk at least this often
const RESTARTS = 1012; // close code of a server that is asked to stop
const AHEAD_M = { least: 1000, usual: 4000, most: 8000 }; // the length of line ahead that the keys + and - select
const CHANGED = [660, 880], BRAKED = [440, 330]; // tones (Hz)

const body = document.body;
const wall = (stamp) => performance.timeOrigin + stamp;
const link = () => body.dataset.link;
const live = () => phase === "driving" || phase === "watching";

let lang = LANGUAGES.find((one) => one === localStorage.getItem("desk-language"));
let words = WORDS[lang ?? "en"];
let ahead = Number(localStorage.getItem("desk-ahead")) || AHEAD_M.usual;
let sound = false, tone = null;

let socket = null, tries = 0, heard = -Infinity, fresh = true;
let phase = "connecting", news = null, hello = null, show = null, replay = null, session = null, ready = false;
let cab = null, before = null, why = {}, got = 0; // the last Cab, the one before it, its reasons, and its time
let card = null, wasBraked = false, seq = 0;
let frameAt = 0, drawn = -1, said = 0, named = 0;

// For measurements: the last times (ms) from frame to frame, and from the sending of a Cab to its drawing.
const measured = window.deskMeasured = { frames: [], drawn: [] };
const keep = (times, ms) => {
  times.push(ms);
  if (times.length > 4000) times.shift();
};

const lever = new Lever($("leverbox"), (ratio, stamp, device) => {
  seq += 1;
  wasBraked = false;
  send({ t: "lever", k: seq, ratio, at: wall(stamp), by: device, look: cab?.look ?? 0 });
});

function send(message) {
  if (socket?.readyState === WebSocket.OPEN && phase !== "taken") socket.send(JSON.stringify(message));
}

// Highlights a part of the page for a moment.
function flash(id) {
  $(id).classList.add("fresh");
  requestAnimationFrame(() => setTimeout(() => $(id).classList.remove("fresh"), 300));
}

function mark(stamp, text) {
  send({ t: "mark", at: wall(stamp), look: cab?.look ?? 0, text });
}

// ---- words
function speak() {
  words = WORDS[lang];
  document.documentElement.lang = lang;
  document.title = words.desk;
  document.querySelectorAll("[data-word]").forEach((one) => fill(one, words[one.dataset.word]));
  fill($("language"), lang.toUpperCase());
  $("language").setAttribute("aria-label", `${words.language}: ${words.name}`);
  $("sound").setAttribute("aria-label", words.sound);
  $("sound").setAttribute("aria-pressed", sound);
  $("sound").title = words.sound;
  $("leverbox").setAttribute("aria-label", words.lever);
  show?.speak(words, lang);
  replay?.speak(words);
  veil();
  card = null; // a change of language is not a change of advice
  if (cab) write();
}

// The title and text of the veil, which hides the page in every phase but driving and replay.
function veiled(state) {
  return {
    welcome: () => [words.desk, words.welcome.replace("{m}", hello.at_stop_m)],
    preparing: () => [words.preparing, ""],
    over: () => [words.over, arrived()],
    broken: () => [words.broken, words.broken_why],
    taken: () => [words.taken, words.taken_why],
    lost: () => [words.lost, hello.watched ? words.connecting : words.lost_why],
    connecting: () => [words.connecting, ""],
    waiting: () => [`${words.train} ${hello.watched}`, missing()],
  }[state]?.();
}

// What is missing for a cab of the train that is watched.
function missing() {
  const others = news.others ? `\n${words.others} ${news.others}` : "";
  return words[`no_${news.missing}`] + others;
}

function veil() {
  const lost = link() === "down" && ["driving", "preparing", "welcome", "watching", "waiting"].includes(phase);
  const stepping = phase === "step";
  document.querySelectorAll("header, main").forEach((one) => one.inert = stepping);
  if (stepping) {
    session?.draw(words, link() === "down", keyList);
    return;
  }
  session?.leave();
  const found = veiled(lost ? "lost" : phase), welcome = phase === "welcome" && !lost;
  if (!found) return;
  fill($("title"), found[0]);
  fill($("text"), found[1]);
  fill($("go"), words.ready);
  $("go").hidden = !welcome;
  $("keys").replaceChildren(...(welcome ? keyList() : []));
  if (welcome) $("go").focus();
}

// The list of keys, with those of tasks beside driving.
function keyList(tasks = []) {
  const keys = [
    ["↑ W", words.k_up],
    ["↓ S", words.k_down],
    ["0", words.k_zero],
    ["End", words.k_full],
    ["+ −", words.k_zoom],
    ["M", words.k_sound],
    ...(session ? [] : [["L", words.k_language]]),
    ["B", words.k_mark],
    ...(tasks.includes("pedal") ? [["V", words.pedal]] : []),
    ...(tasks.includes("detection") ? [["D", words.detection]] : []),
  ];
  const items = keys.map(([key, text]) => make("li", {}, make("kbd", {}, key), text));
  return [...items, make("li", {}, words.k_pointer)];
}

function arrived() {
  if (!cab) return words.over_why;
  const by = cab.stop_m - cab.s_m, where = by >= 0 ? words.stood_before : words.stood_beyond;
  return `${where.replace("{m}", Math.round(Math.abs(by)))}\n${words.over_why}`;
}

// ---- the connection to the server
function connect() {
  const mine = socket = new WebSocket(`ws://${location.host}/desk`);
  fresh = true;
  mine.onmessage = (e) => {
    heard = performance.now();
    const message = JSON.parse(e.data);
    take[message.t](message);
  };
  mine.onclose = (e) => {
    if (mine !== socket) return;
    linked("down");
    if (e.code === RESTARTS && !session && !["over", "replay", "watching", "waiting"].includes(phase)) enter("broken");
    if (session?.ended || (session ? ["taken"] : ["over", "broken", "taken", "replay"]).includes(phase)) return;
    setTimeout(connect, Math.min(200 * 2 ** tries++, 2000));
  };
}

function linked(state) {
  if (link() === state) return;
  body.dataset.link = state;
  $("link").setAttribute("aria-label", state === "up" ? words.connected : words.unconnected);
  veil();
  if (cab && phase !== "replay") write();
}

function enter(to) {
  ready ||= to === "driving";
  phase = body.dataset.phase = to;
  lever.active = to === "driving";
  session?.clear();
  veil();
  if (to === "watching" && cab) write();
  if (to !== "driving") return;
  $("leverbox").focus({ focusVisible: false });
  mark(performance.now(), `way ahead ${ahead} m`);
  markSize();
}

// The handlers of the server's messages, by kind.
const take = {
  hello(m) {
    tries = 0;
    hello = m;
    if (m.session) begin(m);
    lang ??= m.language;
    show = new Shown(m);
    lever.notches = m.notches;
    lever.place(m.lever);
    seq = m.seq;
    const again = m.phase === "welcome" && ready; // a new server has replaced a killed one
    if (again) send({ t: "ready" });
    show.speak(WORDS[lang], lang);
    news = m;
    enter(again ? "preparing" : m.phase);
    linked("up");
    speak();
    if (m.phase === "replay" && !replay) fetchDrive();
  },
  step(m) {
    tries = 0;
    phase = "step";
    begin(m);
    lang ??= "en";
    session.take(m, fresh);
    fresh = false;
    body.dataset.step = m.id;
    enter("step");
    linked("up");
    speak();
  },
  task: (m) => session?.task(m),
  phase(m) {
    news = m;
    enter(m.phase);
  },
  cab(m) {
    before = cab;
    receive(m);
    linked("up");
    if (!live()) enter("driving");
    if (cab.interlock !== SILENCE) return;
    wasBraked = true;
    if (m.seq >= seq && lever.ratio > 0 && cab.speed_mps > 0) lever.set(0, performance.now(), "desk");
  },
  beat: () => linked("up"),
};

// Begins a session, or the next trial of one, in the language of the experiment.
function begin(m) {
  session ??= new Session(send, wall);
  lang = m.language ?? lang;
  $("language").hidden = true;
  cab = before = card = null;
  delete body.dataset.look;
  wasBraked = false;
}

async function fetchDrive() {
  const drive = await (await fetch("drive.json")).json();
  replay = new Replay(drive, (item, last) => {
    before = last.cab;
    lever.place(item.cab.lever_ratio);
    $("say").textContent = "";
    receive(item);
  });
  replay.speak(words);
}

function receive(m) {
  cab = m.cab;
  why = m.why;
  got = performance.now();
  write();
}

// ---- texts: exactly the content of the Cab
function advised() {
  const fresh = phase === "replay" || (link() === "up" && performance.now() - got < STALE_MS);
  return cab && fresh ? show.advice(cab, why) : null;
}

function write() {
  const advice = advised(), braked = cab.interlock === SILENCE, was = card;
  card = show.write(cab, advice, wasBraked && !braked && phase === "driving");
  card.now = card.speed == null ? card.do : `${card.do} ${kmh(card.speed)} km/h`;
  if (!was || was.now === card.now || !(advice || braked)) return;
  flash("advice");
  fill($("say"), card.why ? `${card.now}. ${card.why}` : card.now);
  if (sound) beep(braked ? BRAKED : CHANGED);
}

function beep(pitches) {
  tone ||= new AudioContext();
  tone.resume();
  pitches.forEach((pitch, i) => {
    const note = tone.createOscillator(), loud = tone.createGain(), at = tone.currentTime + 0.13 * i;
    note.frequency.value = pitch;
    loud.gain.setValueAtTime(0.0001, at);
    loud.gain.exponentialRampToValueAtTime(0.12, at + 0.02);
    loud.gain.exponentialRampToValueAtTime(0.0001, at + 0.14);
    note.connect(loud).connect(tone.destination);
    note.start(at);
    note.stop(at + 0.16);
  });
}

// ---- frames: between two Cabs only needle and strip move, at the last rate
function frame(now) {
  requestAnimationFrame(frame);
  const passed = frameAt ? now - frameAt : 0;
  if (frameAt) keep(measured.frames, passed);
  frameAt = now;
  replay?.tick(passed);
  session?.tick();
  lever.pad(now);
  if (live() && performance.now() - heard > STALE_MS) linked("down");
  if (cab) paint();
  if (phase !== "replay") tellDrawn(now);
}

// Reports to the desk, once a frame is on the screen, that the page is visible.
function tellDrawn(now) {
  const look = cab?.look ?? 0, fresh = look !== drawn, sent_ns = cab?.wall_ns;
  if (!fresh && now - said < DRAWN_MS) return;
  drawn = look;
  said = now;
  const { port1, port2 } = new MessageChannel();
  port1.onmessage = () => {
    send({ t: "drawn", look: drawn });
    if (fresh && sent_ns) keep(measured.drawn, wall(performance.now()) - sent_ns / 1e6);
  };
  port2.postMessage(0);
}

// The train's position now, extrapolated from the last Cab at its speed, and the needle at the last rate.
function moved() {
  const gap = before && before !== cab ? cab.clock_s - before.clock_s : 0, steady = gap > 0 && gap < 2;
  const since = (performance.now() - got) / 1000 * (replay?.pace ?? 1);
  const age = live() || replay?.playing ? Math.min(since, steady ? gap + 0.1 : 0.3) : 0;
  const rate = steady ? draw.clamp((cab.speed_mps - before.speed_mps) / gap, -2, 2) : 0;
  const v = cab.speed_mps < 0.01 ? 0 : Math.max(cab.speed_mps + rate * age, 0);
  return { v, rolled: cab.speed_mps * age };
}

// The advised speeds ahead and their places, where they are shown: [m, m/s], a second apart.
function horizon(advice) {
  if (!advice || !show.presentation(cab).path) return [];
  const path = [[cab.s_m, cab.speed_mps]];
  for (const next of cab.horizon_speed_mps) {
    const [s, v] = path.at(-1);
    path.push([s + (v + next) / 2, next]);
  }
  return path;
}

// The length of line ahead that is shown (m): less near the stop.
function view(left) {
  const near = left > -50 && (left < 190 ? 200 : left < 760 && 800);
  return Math.min(ahead, near || ahead);
}

function paint() {
  const { v, rolled } = moved(), s = cab.s_m + rolled, left = cab.stop_m - s;
  const advice = advised(), changes = show.changes(cab, advice), limit = show.limit(cab);
  const { gradients, stops } = hello.line;
  draw.dial($("dial"), {
    v,
    limit,
    words,
    shown: kmh(cab.speed_mps),
    top: hello.train.top_mps,
    advice: advice?.speed,
    left: left < 300 && left > -200 ? left : null,
    missed: left < -hello.at_stop_m,
  });
  if (phase !== "watching") {
    draw.lever($("lever"), {
      words,
      ratio: lever.ratio,
      advised: advice?.effort,
      notches: hello.notches,
      most: show.efforts(cab.speed_mps),
      given: cab.look && cab.force_el_n != null ? [cab.force_el_n, cab.force_friction_n] : null,
      braked: cab.interlock === SILENCE,
    });
  }
  draw.way($("ahead"), {
    s,
    v,
    gradients,
    stops,
    lang,
    ahead: view(left),
    limits: show.allowed(cab),
    slow: show.slow(cab),
    signal: cab.signal_m,
    path: horizon(advice),
    changes: changes.filter((one) => one.way != null).map((one) => ({ ...one, way: one.way - rolled })),
  });
  draw.sign($("sign"), card.sign ?? card.mode);
  draw.lamp($("lamp"), cab.signal_m == null && (cab.may_depart || cab.speed_mps > 0.05));
  if (performance.now() - named < 1000) return;
  named = performance.now();
  $("dial").setAttribute("aria-label", `${kmh(cab.speed_mps)} km/h, ${words.limit_is} ${kmh(limit)}`);
  const way = distance(Math.max(left, 0), lang);
  $("ahead").setAttribute("aria-label", `${words.stop} ${show.stopName(cab)} ${way}`);
}

// ---- keys and buttons
function zoom(factor) {
  ahead = draw.clamp(ahead * factor, AHEAD_M.least, AHEAD_M.most);
  localStorage.setItem("desk-ahead", ahead);
  mark(performance.now(), `way ahead ${ahead} m`);
}

// Reports the size of the page to the desk; the browser's zoom changes both figures.
function markSize() {
  mark(performance.now(), `size ${innerWidth} × ${innerHeight}, ${devicePixelRatio.toFixed(2)} px`);
}

function nextLanguage() {
  lang = LANGUAGES[(LANGUAGES.indexOf(lang) + 1) % LANGUAGES.length];
  localStorage.setItem("desk-language", lang);
  mark(performance.now(), `language ${lang}`);
  speak();
}

function switchSound() {
  sound = !sound;
  if (sound) beep(CHANGED);
  mark(performance.now(), `sound ${sound ? "on" : "off"}`);
  speak();
}

// Handles a key; returns whether the page uses it.
function key(e) {
  const pressed = document.activeElement?.tagName === "BUTTON" && (e.code === "Enter" || e.code === "Space");
  if (!pressed && phase === "driving" && lever.key(e)) return true;
  if (!pressed && replay?.key(e)) return true;
  if (phase === "driving" && !e.repeat && session?.key(e, cab?.look ?? 0)) return true;
  if (e.key === "+" || e.key === "=") zoom(0.5);
  else if (e.key === "-" || e.key === "−") zoom(2);
  else if (e.repeat) return false;
  else if (e.code === "KeyM") switchSound();
  else if (e.code === "KeyL" && !session) nextLanguage();
  else if (e.code === "KeyB" && phase === "driving") {
    mark(e.timeStamp, "");
    flash("clock");
  } else return false;
  return true;
}

addEventListener("keydown", (e) => {
  if (hello && phase !== "step" && !e.ctrlKey && !e.altKey && !e.metaKey && key(e)) e.preventDefault();
});
let resized = 0;
addEventListener("resize", () => {
  clearTimeout(resized);
  resized = setTimeout(markSize, 300); // only the last size of a dragged window is reported
});
$("language").onclick = nextLanguage;
$("sound").onclick = switchSound;
$("go").onclick = () => {
  if (phase === "step") {
    if (session.step.kind === "consent") session.consent("yes");
    else session.next();
    return;
  }
  ready = true;
  $("go").hidden = true;
  send({ t: "ready" });
};
connect();
requestAnimationFrame(frame);
