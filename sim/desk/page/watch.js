// The experimenter's page: shows the state of a session, and sends marks, notes and the request to end a trial.
import { $, distance, fill, kmh, minutes, span } from "./show.js";

const STALE_MS = 3000; // the state comes once a second
const percent = (ratio) => `${Math.round(100 * Math.abs(ratio))} % ${ratio > 0 ? "power" : ratio < 0 ? "brake" : ""}`;
const late = (s) => (Math.abs(s) < 0.5 ? "on time" : `${span(s)} ${s > 0 ? "late" : "early"}`);
const shown = (value, words) => (value == null ? "–" : words(value));
let socket = null, tries = 0, heard = -Infinity, running = false, asks = null;

function connect() {
  socket = new WebSocket(`ws://${location.host}/watching`);
  socket.onmessage = (e) => {
    const message = JSON.parse(e.data);
    heard = performance.now();
    if (message.t === "state") show(message);
  };
  socket.onopen = () => tries = 0;
  socket.onclose = () => setTimeout(connect, Math.min(200 * 2 ** tries++, 2000));
}

function send(message, said) {
  const open = socket.readyState === WebSocket.OPEN;
  if (open) socket.send(JSON.stringify(message));
  fill($("news"), open ? said : "Not sent: no connection");
}

function show({ participant, step, trial, of, practice, condition, driven_s, cab, events, others }) {
  running = driven_s != null;
  fill($("participant"), participant);
  fill($("step"), `${step ?? "–"}`);
  fill($("trial"), practice ? "practice" : of ? `${trial} of ${of} measured` : "–");
  fill($("condition"), condition || "–");
  $("abort").disabled = !running;
  list("figures", [
    ["Driven", shown(driven_s, minutes)],
    ["Speed", shown(cab?.speed_mps, (v) => `${kmh(v)} km/h`)],
    ["Limit", shown(cab?.limit_mps, (v) => `${kmh(v)} km/h`)],
    ["Advice", shown(cab?.display_speed_mps, (v) => `${kmh(v)} km/h`)],
    ["Lever", shown(cab?.lever_ratio, percent)],
    ["Delay", shown(cab?.late_s, late)],
    ["Next stop", shown(cab && cab.stop_m - cab.s_m, (m) => distance(Math.max(m, 0), "en"))],
  ]);
  list("events", events.toReversed().map(({ at_s, text }) => [shown(at_s, minutes), text]));
  list("others", others.map((one) => [one.participant, `${one.done} of ${one.of} trials, ${one.state}`]));
}

// Writes rows of texts; a list that has not changed keeps its place.
function list(id, rows) {
  const items = rows.map((texts) => {
    const item = document.createElement("li");
    item.append(...texts.map((text) => Object.assign(document.createElement("span"), { textContent: text })));
    return item;
  });
  const written = (all) => all.map((one) => one.textContent).join();
  if (written(items) !== written([...$(id).children])) $(id).replaceChildren(...items);
}

function mark(text) {
  send({ t: "mark", text }, `Mark ${text} set`);
}

// Asks for the words of a note, or whether to end the trial.
function ask(what) {
  if (what === "abort" && !running) return;
  const note = what === "note";
  asks = what;
  fill($("question"), note ? "Note" : "End this trial now?");
  fill($("yes"), note ? "Save (Ctrl + Enter)" : "End the trial");
  $("words").hidden = !note;
  $("effect").hidden = note;
  $("ask").showModal();
  (note ? $("words") : $("no")).focus();
}

function agreed() {
  const text = $("words").value.trim();
  $("ask").close();
  if (asks === "abort") send({ t: "abort" }, "The trial ends");
  else if (text) {
    send({ t: "note", text }, "Note saved");
    $("words").value = "";
  }
}

addEventListener("keydown", (e) => {
  if ($("ask").open) {
    if (asks === "note" && e.ctrlKey && e.code === "Enter") agreed();
    return;
  }
  if (e.repeat || e.ctrlKey || e.altKey || e.metaKey) return;
  if (/^[1-9]$/.test(e.key)) mark(e.key);
  else if (e.key.toLowerCase() === "m") mark("M");
  else if (e.key.toLowerCase() === "n") ask("note");
  else if (e.key.toLowerCase() === "a") ask("abort");
  else return;
  e.preventDefault();
});
$("mark").onclick = () => mark("M");
$("note").onclick = () => ask("note");
$("abort").onclick = () => ask("abort");
$("yes").onclick = agreed;
$("no").onclick = () => $("ask").close();
setInterval(() => {
  const link = performance.now() - heard < STALE_MS ? "up" : "down";
  if (link === "down" && heard > 0) fill($("news"), "No news from the desk");
  else if (document.body.dataset.link === "down") fill($("news"), "");
  document.body.dataset.link = link;
}, 500);
connect();
