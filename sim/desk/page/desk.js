// The cab desk: shows the last Cab, and sends where the lever is set. It keeps nothing that the server lacks but zoom, sound and language.
import * as draw from "./draw.js";
import { Lever } from "./lever.js";
import { Replay } from "./replay.js";
import { $, SILENCE, Shown, distance, fill, kmh } from "./show.js";
import { WORDS } from "./words.js";

const body = document.body, LANGUAGES = Object.keys(WORDS), STALE_MS = 1500, DRAWN_MS = 400, KEPT = 4000;
const wall = (stamp) => performance.timeOrigin + stamp;
const stats = { frames: 0, since: 0, fps: [], longest: 0, last: 0, cabs: 0, lag: [] };
window.deskStats = stats;
let lang = localStorage.getItem("desk-language") || "", W = WORDS.en, sound = false, tone = null, socket = null, tries = 0, heard = -1e9;
let hello = null, show = null, replay = null, phase = "connecting", cab = null, before = null, why = {}, got = 0, seq = 0, drawn = -1, said = 0, card = null, wasBraked = false, ready = false;
let ahead = Number(localStorage.getItem("desk-ahead")) || 4000, painted = 0;

const lever = new Lever($("leverbox"), (ratio, stamp, device) => { seq += 1; wasBraked = false; send({ t: "lever", k: seq, ratio, at: wall(stamp), by: device, look: cab?.look ?? 0 }); });
const send = (message) => { if (socket?.readyState === 1 && phase !== "taken") socket.send(JSON.stringify(message)); };
const live = () => body.dataset.link === "up" || phase === "replay";

// ---- words
function speak() {
  W = WORDS[lang] ?? WORDS.en; document.documentElement.lang = lang; document.title = W.desk;
  document.querySelectorAll("[data-word]").forEach((one) => fill(one, W[one.dataset.word]));
  fill($("language"), lang.toUpperCase()); $("language").setAttribute("aria-label", `${W.language}: ${W.name}`);
  $("sound").setAttribute("aria-label", W.sound); $("sound").setAttribute("aria-pressed", sound); $("sound").title = W.sound; $("leverbox").setAttribute("aria-label", W.lever);
  show?.speak(W, lang); replay?.speak(W); veil(); if (cab) write();
}
function veil() {
  const lost = body.dataset.link === "down" && ["driving", "preparing", "welcome"].includes(phase), state = lost ? "lost" : phase;
  const text = { welcome: [hello && `${W.desk} · ${hello.title}`, W.welcome], preparing: [W.preparing, ""], over: [W.over, arrived()], broken: [W.broken, W.broken_why], taken: [W.taken, W.taken_why], refused: [W.refused, W.refused_why], lost: [W.lost, W.lost_why], connecting: [W.connecting, ""] }[state];
  if (!text) return;
  fill($("title"), text[0] || W.desk); fill($("text"), text[1]); $("go").hidden = state !== "welcome"; fill($("go"), W.ready);
  const keys = state === "welcome" ? [["↑ W", W.k_up], ["↓ S", W.k_down], ["0", W.k_zero], ["End", W.k_full], ["+ −", W.k_zoom], ["M", W.k_sound], ["L", W.k_language], ["B", W.k_mark]] : [];
  $("keys").replaceChildren(...keys.map(([key, words]) => { const li = document.createElement("li"), k = document.createElement("kbd"); k.textContent = key; li.append(k, words); return li; }));
  if (state === "welcome") { const li = document.createElement("li"); li.append(W.k_pointer); $("keys").append(li); $("go").focus(); }
}
function arrived() {
  if (!cab) return W.over_why;
  const by = cab.stop_m - cab.s_m, where = (by >= 0 ? W.stood_before : W.stood_beyond).replace("{m}", Math.round(Math.abs(by)));
  return `${where}\n${W.over_why}`;
}
function enter(to) { ready ||= to === "driving"; phase = body.dataset.phase = to; lever.active = to === "driving"; veil(); if (to === "driving") $("leverbox").focus({ focusVisible: false }); }

// ---- the line to the server
function link(state) { if (body.dataset.link === state) return; body.dataset.link = state; $("link").setAttribute("aria-label", state === "up" ? W.connected : W.unconnected); veil(); if (cab && phase !== "replay") write(); }
function connect() {
  const mine = socket = new WebSocket(`ws://${location.host}/desk`);
  mine.onmessage = (e) => { heard = performance.now(); take(JSON.parse(e.data)); };
  mine.onclose = (e) => {
    if (mine !== socket) return;
    link("down");
    if (e.code === 1012 && !["over", "replay"].includes(phase)) enter("broken");
    if (["over", "broken", "taken", "replay"].includes(phase)) return;
    setTimeout(connect, Math.min(200 * 2 ** tries++, 2000));
  };
}
function take(m) {
  if (m.t === "hello") {
    tries = 0; hello = m; lang ||= m.language; show = new Shown(m); show.speak(WORDS[lang] ?? WORDS.en, lang); lever.notches = m.notches; lever.place(m.lever); seq = m.seq;
    if (m.phase === "welcome" && ready) send({ t: "ready" }); // a new server has taken the place of one that was killed
    enter(m.phase === "welcome" && ready ? "preparing" : m.phase); link("up"); speak();
    if (m.phase === "replay" && !replay) fetch("drive.json").then((r) => r.json()).then((drive) => { replay = new Replay(drive, (item, last) => { before = last.cab; lever.place(item.cab.lever_ratio); $("say").textContent = ""; receive(item); }); replay.speak(W); });
  } else if (m.t === "phase") enter(m.phase);
  else if (m.t === "cab") {
    before = cab; stats.cabs += 1; receive(m); link("up"); if (phase !== "driving") enter("driving");
    if (cab.interlock === SILENCE) { wasBraked = true; if (m.seq >= seq && lever.ratio > 0 && cab.speed_mps > 0) lever.set(0, performance.now(), "desk"); }
  }
  if (body.dataset.link === "down" && m.t === "beat") link("up");
}
function receive(m) { cab = m.cab; why = m.why; got = performance.now(); write(); }

// ---- what is written: exactly what the Cab says
const advised = () => (live() && cab && (phase === "replay" || performance.now() - got < STALE_MS) ? show.advice(cab, why) : null);
function write() {
  const advice = advised(), was = card; card = show.write(cab, advice, wasBraked && cab.interlock !== SILENCE && phase === "driving");
  const now = `${card.do} ${card.speed == null ? "" : kmh(card.speed)}`;
  if (was && was.now !== now && (advice || cab.interlock === SILENCE)) {
    $("advice").classList.add("fresh"); requestAnimationFrame(() => setTimeout(() => $("advice").classList.remove("fresh"), 300));
    fill($("say"), `${now}${card.speed == null ? "" : " km/h"}. ${card.why}`); if (sound) beep(card.mode === "braked" ? [440, 330] : [660, 880]);
  }
  card.now = now;
}
function beep(tones) {
  tone ||= new AudioContext(); tone.resume();
  tones.forEach((pitch, i) => {
    const o = tone.createOscillator(), g = tone.createGain(), t = tone.currentTime + 0.13 * i; o.frequency.value = pitch;
    g.gain.setValueAtTime(0.0001, t); g.gain.exponentialRampToValueAtTime(0.12, t + 0.02); g.gain.exponentialRampToValueAtTime(0.0001, t + 0.14); o.connect(g).connect(tone.destination); o.start(t); o.stop(t + 0.16);
  });
}

// ---- frames: between two Cabs only needle and strip move on, at the last rate
function frame(now) {
  requestAnimationFrame(frame);
  if (stats.last) stats.longest = Math.max(stats.longest, now - stats.last);
  if (replay) replay.tick(now - (stats.last || now));
  stats.last = now; stats.frames += 1;
  if (now - stats.since >= 1000) { if (stats.since) stats.fps.push(stats.frames * 1000 / (now - stats.since)); if (stats.fps.length > KEPT) stats.fps.shift(); stats.frames = 0; stats.since = now; body.dataset.fps = (stats.fps.at(-1) ?? 0).toFixed(1); }
  lever.pad(now);
  if (phase === "driving" && body.dataset.link === "up" && performance.now() - heard > STALE_MS) link("down");
  if (hello && cab) paint();
  if (phase === "replay" || (drawn === (cab?.look ?? -1) && now - said < DRAWN_MS)) return;
  const fresh = drawn !== (cab?.look ?? -1), sent = cab?.wall_ns; drawn = cab?.look ?? -1; said = now;
  const { port1, port2 } = new MessageChannel();
  port1.onmessage = () => { send({ t: "drawn", look: Math.max(drawn, 0) }); if (fresh && sent) { stats.lag.push(wall(performance.now()) - sent / 1e6); if (stats.lag.length > KEPT) stats.lag.shift(); } };
  port2.postMessage(0);
}
function paint() {
  const gap = before && before !== cab ? cab.clock_s - before.clock_s : 0, runs = phase === "driving" || replay?.playing;
  const age = runs ? Math.min((performance.now() - got) / 1000 * (replay ? replay.pace : 1), gap > 0 && gap < 2 ? gap + 0.1 : 0.3) : 0;
  const rate = gap > 0 && gap < 2 ? Math.min(Math.max((cab.speed_mps - before.speed_mps) / gap, -2), 2) : 0;
  const v = cab.speed_mps < 0.01 ? 0 : Math.max(cab.speed_mps + rate * age, 0), s = cab.s_m + cab.speed_mps * age, advice = advised();
  const left = cab.stop_m - s, near = left < 300 && (left > -200) ? left : null, changes = show.changes(cab, advice), limit = show.limit(cab), braked = cab.interlock === SILENCE;
  const reach = changes.find((x) => !x.second && ["brake", "hold", "traction"].includes(x.mode) && x.time < 60) ? cab.next_speed_mps : null;
  draw.dial($("dial"), { v, shown: kmh(cab.speed_mps), limit, top: hello.train.top_mps, advice: advice?.speed ?? null, reach: reach != null && Math.abs(reach - (advice?.speed ?? -99)) > 8 / draw.KMH ? reach : null, left: near, words: W });
  const given = cab.look && cab.force_el_n != null ? [cab.force_el_n, cab.force_friction_n] : null;
  draw.lever($("lever"), { ratio: lever.ratio, advised: advice?.effort ?? null, notches: hello.notches, most: show.efforts(cab.speed_mps), given, braked, words: W });
  const path = [], horizon = advice && hello.presentations[cab.presentation].name === "vector" ? cab.horizon_speed_mps : [];
  if (horizon.length) { let x = cab.s_m, u = cab.speed_mps; path.push([x, u]); for (const p of horizon) { x += (u + p) / 2; u = p; path.push([x, u]); } }
  const view = Math.min(ahead, left < 190 && left > -50 ? 200 : left < 760 && left > -50 ? 800 : ahead);
  draw.way($("ahead"), { s, v, ahead: view, limits: show.allowed(cab), slow: show.slow(cab), gradients: hello.line.gradients, tunnels: hello.line.tunnels, stops: hello.line.stops, signal: cab.signal_m, path, changes: changes.filter((x) => x.way != null).map((x) => ({ ...x, way: x.way - cab.speed_mps * age })), lang });
  draw.sign($("sign"), card?.mode ?? "none"); draw.lamp($("lamp"), cab.signal_m == null && (cab.may_depart || cab.speed_mps > 0.05));
  if (performance.now() - painted > 1000) { painted = performance.now(); $("dial").setAttribute("aria-label", `${kmh(cab.speed_mps)} km/h, ${W.limit_is} ${kmh(limit)}`); $("ahead").setAttribute("aria-label", `${W.stop} ${show.stopName(cab)} ${distance(Math.max(left, 0), lang)}`); }
}

// ---- keys and buttons
const zoom = (factor) => { ahead = Math.min(Math.max(ahead * factor, 1000), 8000); localStorage.setItem("desk-ahead", ahead); };
const setting = (text) => send({ t: "mark", at: wall(performance.now()), look: cab?.look ?? 0, text });
const other = () => { lang = LANGUAGES[(LANGUAGES.indexOf(lang) + 1) % LANGUAGES.length]; localStorage.setItem("desk-language", lang); setting(`language ${lang}`); speak(); };
const quiet = () => { sound = !sound; if (sound) beep([660, 880]); setting(`sound ${sound ? "on" : "off"}`); speak(); };
addEventListener("keydown", (e) => {
  if (e.ctrlKey || e.altKey || e.metaKey || !hello) return;
  const onButton = document.activeElement?.tagName === "BUTTON" && (e.code === "Enter" || e.code === "Space");
  let mine = true;
  if (phase === "driving" && !onButton && lever.key(e)) mine = true;
  else if (replay && !onButton && replay.key(e)) mine = true;
  else if (e.key === "+" || e.key === "=") zoom(0.5);
  else if (e.key === "-" || e.key === "−") zoom(2);
  else if (e.code === "KeyM" && !e.repeat) quiet();
  else if (e.code === "KeyL" && !e.repeat) other();
  else if (e.code === "KeyB" && !e.repeat && phase === "driving") send({ t: "mark", at: wall(e.timeStamp), look: cab?.look ?? 0, text: "" });
  else mine = false;
  if (mine) e.preventDefault();
});
$("language").onclick = other; $("sound").onclick = quiet;
$("go").onclick = () => { ready = true; $("go").hidden = true; send({ t: "ready" }); };
connect(); requestAnimationFrame(frame);
