// The words of the page that are not advice: the server sends those of the advice.
// Names are always set as text, never as HTML. {m} stands for a number of metres.
export const LANGUAGES = ["en", "de", "fr"];
const ROWS = {
  name: ["English", "Deutsch", "Français"],
  desk: ["Cab desk", "Führerpult", "Pupitre"],
  next_stop: ["Next stop", "Nächster Halt", "Prochain arrêt"],
  coming: ["Coming up", "Als Nächstes", "À venir"],
  due: ["due", "an", "arr."],
  departs: ["departs", "ab", "dép."],
  sound: ["Sound at changes of the advice", "Ton bei neuer Empfehlung", "Son aux changements du conseil"],
  language: ["Language", "Sprache", "Langue"],
  connected: ["connected", "verbunden", "connecté"],
  unconnected: ["not connected", "nicht verbunden", "déconnecté"],
  limit_is: ["limit", "Höchstgeschwindigkeit", "limite"],
  no_advice_why: [
    "Drive by the limits and the timetable",
    "Nach Geschwindigkeit und Fahrplan fahren",
    "Suivre les limites et l’horaire",
  ],
  power: ["power", "Zugkraft", "traction"],
  brake: ["brake", "Bremse", "frein"],
  at_most: ["Drive at most", "Höchstens fahren", "Rouler au plus à"],
  slow_to: ["Slow down to", "Verlangsamen auf", "Ralentir à"],
  soon: ["in", "in", "dans"],
  to_stop: ["to the stop", "bis zum Halt", "jusqu’à l’arrêt"],
  beyond: ["beyond the stop", "hinter dem Halt", "après l’arrêt"],
  limit: ["Limit", "Vmax", "Limite"],
  stop: ["Stop", "Halt", "Arrêt"],
  signal: ["Signal at stop", "Signal auf Halt", "Signal fermé"],
  wait: ["Wait", "Warten", "Attendre"],
  wait_why: ["No power before", "Keine Zugkraft vor", "Pas de traction avant"],
  too_fast: ["Too fast", "Zu schnell", "Trop vite"],
  depart: ["Depart", "Abfahren", "Partir"],
  depart_why: ["Doors closed, signal clear", "Türen zu, Signal offen", "Portes fermées, signal ouvert"],
  clear: ["Line clear", "Fahrt frei", "Voie libre"],
  stopped: ["Stopped", "Steht", "À l’arrêt"],
  braked: ["Braked", "Gebremst", "Freiné"],
  braked_why: [
    "The connection was lost. When the train stands and the lever is at 0, you may drive on.",
    "Die Verbindung war weg. Wenn der Zug steht und der Hebel auf 0 ist, dürfen Sie weiterfahren.",
    "La connexion était perdue. À l’arrêt, manipulateur à 0, vous pourrez repartir.",
  ],
  was_braked: ["You were braked", "Sie wurden gebremst", "Vous avez été freiné"],
  was_braked_why: [
    "The connection was lost. You may drive on.",
    "Die Verbindung war weg. Sie dürfen weiterfahren.",
    "La connexion était perdue. Vous pouvez repartir.",
  ],
  lever: ["Lever for power and brake", "Hebel für Zugkraft und Bremse", "Manipulateur de traction et de frein"],
  pwr: ["POWER", "KRAFT", "TRACTION"],
  brk: ["BRAKE", "BREMSE", "FREIN"],
  friction: ["air", "Luft", "air"],
  welcome: [
    "You drive this train to its next stops, on time. Stay below the limit, which is white. Before a stop the metres " +
    "count down: stand within {m} m of 0.\n" +
    "Violet is advice that saves energy: its triangles mark a speed and a place of the lever. It never allows more " +
    "than the limit. Without violet, drive by the limits and the timetable.",
    "Sie fahren diesen Zug pünktlich zu seinen nächsten Halten. Bleiben Sie unter der Höchstgeschwindigkeit, sie ist " +
    "weiss. Vor einem Halt zählen die Meter herunter: Halten Sie auf {m} m genau bei 0.\n" +
    "Violett ist eine Empfehlung, die Energie spart: Ihre Dreiecke zeigen eine Geschwindigkeit und eine Stellung des " +
    "Hebels. Sie erlaubt nie mehr als die Höchstgeschwindigkeit. Ohne Violett fahren Sie nach Geschwindigkeit und " +
    "Fahrplan.",
    "Vous conduisez ce train à ses prochains arrêts, à l’heure. Restez sous la limite, qui est blanche. Avant un " +
    "arrêt, un compte à rebours donne les mètres : arrêtez-vous à moins de {m} m de 0.\n" +
    "Le violet est un conseil qui économise l’énergie : ses triangles indiquent une vitesse et une position du " +
    "manipulateur. Il ne permet jamais plus que la limite. Sans violet, suivez les limites et l’horaire.",
  ],
  ready: ["I am ready", "Ich bin bereit", "Je suis prêt"],
  preparing: ["The train is being prepared …", "Der Zug wird vorbereitet …", "Le train se prépare …"],
  over: ["Arrived", "Angekommen", "Arrivé"],
  over_why: [
    "Thank you. The drive is recorded.",
    "Danke. Die Fahrt ist aufgezeichnet.",
    "Merci. Le trajet est enregistré.",
  ],
  stood_before: [
    "You stopped {m} m before the mark.",
    "Sie hielten {m} m vor der Marke.",
    "Arrêt {m} m avant le repère.",
  ],
  stood_beyond: [
    "You stopped {m} m beyond the mark.",
    "Sie hielten {m} m hinter der Marke.",
    "Arrêt {m} m après le repère.",
  ],
  broken: ["The drive was ended", "Die Fahrt wurde beendet", "Le trajet a été interrompu"],
  broken_why: [
    "The recording up to here is kept. Please ask whoever started it.",
    "Die Aufzeichnung bis hierher bleibt. Bitte fragen Sie, wer sie gestartet hat.",
    "L’enregistrement jusqu’ici est conservé. Demandez à qui l’a lancé.",
  ],
  lost: ["Connection lost", "Verbindung verloren", "Connexion perdue"],
  lost_why: [
    "Trying again … The train is braked until the desk is back.",
    "Neuer Versuch … Der Zug wird gebremst, bis das Pult zurück ist.",
    "Nouvel essai … Le train est freiné jusqu’au retour du pupitre.",
  ],
  connecting: ["Connecting …", "Verbindung wird aufgebaut …", "Connexion …"],
  taken: [
    "The desk is open in another window",
    "Das Pult ist in einem anderen Fenster offen",
    "Le pupitre est ouvert dans une autre fenêtre",
  ],
  taken_why: [
    "Drive there, or reload this page to drive here.",
    "Fahren Sie dort, oder laden Sie diese Seite neu.",
    "Conduisez là-bas, ou rechargez cette page.",
  ],
  k_up: ["more power, less brake", "mehr Kraft, weniger Bremse", "plus de traction, moins de frein"],
  k_down: ["more brake, less power", "mehr Bremse, weniger Kraft", "plus de frein, moins de traction"],
  k_zero: ["no power, no brake", "weder Kraft noch Bremse", "ni traction ni frein"],
  k_full: ["full brake", "voll bremsen", "frein à fond"],
  k_zoom: ["see nearer / further", "näher / weiter sehen", "voir plus près / loin"],
  k_sound: ["sound", "Ton", "son"],
  k_language: ["language", "Sprache", "langue"],
  k_mark: ["mark this moment", "diesen Moment merken", "noter ce moment"],
  k_pointer: ["drag the lever, or use a gamepad", "Hebel ziehen, oder Gamepad", "tirer le manipulateur, ou manette"],
  play: ["Play", "Abspielen", "Lire"],
  pause: ["Pause", "Anhalten", "Pause"],
  before: ["Bookmark before", "Lesezeichen davor", "Signet précédent"],
  after: ["Next bookmark", "Nächstes Lesezeichen", "Signet suivant"],
  pace: ["Speed of the replay", "Tempo der Wiedergabe", "Vitesse de lecture"],
  place: ["Moment of the drive", "Moment der Fahrt", "Moment du trajet"],
};

// The words by language.
export const WORDS = Object.fromEntries(
  LANGUAGES.map((lang, i) => [lang, Object.fromEntries(Object.entries(ROWS).map(([key, words]) => [key, words[i]]))]),
);
