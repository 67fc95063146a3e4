// The experimenter's page: shows the state of a session, and sends marks, notes and the request to end a trial.
import { $, distance, fill, kmh, make, minutes, span } from "./show.js";
import { spoken, WORDS } from "./words.js";

// The words of this page only, which participants do not see.
const OWN = spoken({
  title: ["Experimenter", "Versuchsleitung", "Expérimentation"],
  step: ["Step", "Schritt", "Étape"],
  trial: ["Trial", "Fahrt", "Trajet"],
  condition: ["Condition", "Bedingung", "Condition"],
  practice: ["practice", "Übung", "entraînement"],
  measured: ["{n} of {m} measured", "{n} von {m} gemessenen", "{n} sur {m} mesurés"],
  running: ["The running trial", "Die laufende Fahrt", "Le trajet en cours"],
  driven: ["Driven", "Gefahren", "Durée"],
  speed: ["Speed", "Geschwindigkeit", "Vitesse"],
  advice: ["Advice", "Empfehlung", "Conseil"],
  lever: ["Lever", "Hebel", "Manipulateur"],
  delay: ["Delay", "Verspätung", "Retard"],
  on_time: ["on time", "pünktlich", "à l’heure"],
  late: ["{m} late", "{m} zu spät", "{m} de retard"],
  early: ["{m} early", "{m} zu früh", "{m} d’avance"],
  events: ["Events", "Ereignisse", "Événements"],
  participants: ["Participants", "Teilnehmende", "Participants"],
  trials: ["{n} of {m} trials", "{n} von {m} Fahrten", "{n} trajets sur {m}"],
  not_begun: ["not begun", "nicht begonnen", "pas commencé"],
  altered: ["the journal was altered", "das Journal wurde verändert", "le journal a été modifié"],
  note: ["Note", "Notiz", "Note"],
  mark_now: ["Mark this moment", "Moment markieren", "Marquer ce moment"],
  mark_number: ["mark with a number", "Markierung mit Nummer", "marque numérotée"],
  marked: ["Mark {m} set", "Markierung {m} gesetzt", "Marque {m} placée"],
  end_trial: ["End this trial …", "Fahrt beenden …", "Terminer ce trajet …"],
  end_now: ["End this trial now?", "Diese Fahrt jetzt beenden?", "Terminer ce trajet maintenant\u00a0?"],
  effect: [
    "The trial is kept as interrupted, and repeated or skipped as the design says.",
    "Die Fahrt gilt als abgebrochen und wird je nach Versuchsplan wiederholt oder übersprungen.",
    "Le trajet est enregistré comme interrompu, puis répété ou sauté selon le plan.",
  ],
  end: ["End the trial", "Fahrt beenden", "Terminer le trajet"],
  ends: ["The trial ends", "Die Fahrt wird beendet", "Le trajet se termine"],
  back: ["Back", "Zurück", "Retour"],
  save: ["Save (Ctrl + Enter)", "Speichern (Strg + Eingabe)", "Enregistrer (Ctrl + Entrée)"],
  saved: ["Note saved", "Notiz gespeichert", "Note enregistrée"],
  not_sent: ["Not sent: no connection", "Nicht gesendet: keine Verbindung", "Non envoyé : pas de connexion"],
  no_news: ["No news from the desk", "Keine Nachricht vom Pult", "Aucune nouvelle du pupitre"],
});
const EVENTS = spoken({
  mark: ["mark", "Markierung", "marque"],
  note: ["note", "Notiz", "note"],
  left: ["continued", "weiter", "suite"],
  driven: ["driven", "gefahren", "effectué"],
  braked: ["stopped by the dead-man brake", "durch die Totmannbremse gebremst", "freiné par le dispositif de veille"],
  interrupted: ["interrupted,", "abgebrochen,", "interrompu,"],
  stopped: ["stopped taking part", "Teilnahme beendet", "participation arrêtée"],
});
const STALE_MS = 3000; // the state comes once a second
const NO_STEPS = ["not_begun", "altered"]; // states of participants that are no steps
const shown = (value, words) => (value == null ? "–" : words(value));
let socket = null, tries = 0, heard = -Infinity, running = false, asks = null, lang = "", words = OWN.en;

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
  fill($("news"), open ? said : words.not_sent);
}

// Sets the language of the desk.
function speak(language) {
  if (language === lang) return;
  lang = document.documentElement.lang = language;
  words = { ...WORDS[lang], ...OWN[lang] };
  document.title = words.title;
  document.querySelectorAll("[data-word]").forEach((one) => fill(one, words[one.dataset.word]));
}

const counted = (text, n, m) => text.replace("{n}", n).replace("{m}", m);
const late = (s) => Math.abs(s) < 0.5 ? words.on_time : words[s > 0 ? "late" : "early"].replace("{m}", span(s));
const percent = (ratio) =>
  `${Math.round(100 * Math.abs(ratio))} % ${ratio > 0 ? words.power : ratio < 0 ? words.brake : ""}`;

function show({ language, participant, step, trial, of, practice, condition, driven_s, cab, events, others }) {
  speak(language);
  running = driven_s != null;
  fill($("participant"), participant);
  fill($("step"), `${step ?? "–"}`);
  fill($("trial"), practice ? words.practice : of ? counted(words.measured, trial, of) : "–");
  fill($("condition"), condition || "–");
  $("abort").disabled = !running;
  list("figures", [
    [words.driven, shown(driven_s, minutes)],
    [words.speed, shown(cab?.speed_mps, (v) => `${kmh(v)} km/h`)],
    [words.limit, shown(cab?.limit_mps, (v) => `${kmh(v)} km/h`)],
    [words.advice, shown(cab?.display_speed_mps, (v) => `${kmh(v)} km/h`)],
    [words.lever, shown(cab?.lever_ratio, percent)],
    [words.delay, shown(cab?.late_s, late)],
    [words.next_stop, shown(cab && cab.stop_m - cab.s_m, (m) => distance(Math.max(m, 0), lang))],
  ]);
  list(
    "events",
    events.toReversed().map(({ at_s, step, what, said }) => [
      shown(at_s, minutes),
      `${step}: ${[EVENTS[lang][what], said].filter(Boolean).join(" ")}`,
    ]),
  );
  list(
    "others",
    others.map((one) => [
      one.participant,
      NO_STEPS.includes(one.state) ? words[one.state] : `${counted(words.trials, one.done, one.of)}, ${one.state}`,
    ]),
  );
}

// Writes rows of texts; a list that has not changed keeps its place.
function list(id, rows) {
  const items = rows.map((texts) => make("li", {}, ...texts.map((textContent) => make("span", { textContent }))));
  const written = (all) => all.map((one) => one.textContent).join();
  if (written(items) !== written([...$(id).children])) $(id).replaceChildren(...items);
}

function mark(text) {
  send({ t: "mark", text }, words.marked.replace("{m}", text));
}

// Asks for the words of a note, or whether to end the trial.
function ask(what) {
  if (what === "abort" && !running) return;
  const note = what === "note";
  asks = what;
  fill($("question"), note ? words.note : words.end_now);
  fill($("yes"), note ? words.save : words.end);
  $("words").hidden = !note;
  $("effect").hidden = note;
  $("ask").showModal();
  (note ? $("words") : $("no")).focus();
}

function agreed() {
  const text = $("words").value.trim();
  $("ask").close();
  if (asks === "abort") send({ t: "abort" }, words.ends);
  else if (text) {
    send({ t: "note", text }, words.saved);
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
  if (link === "down" && heard > 0) fill($("news"), words.no_news);
  else if (document.body.dataset.link === "down") fill($("news"), "");
  document.body.dataset.link = link;
}, 500);
speak("en");
connect();
