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
    "Keep to the limits and the timetable",
    "Höchstgeschwindigkeit und Fahrplan beachten",
    "Respecter les limites et l’horaire",
  ],
  power: ["power", "Zugkraft", "traction"],
  brake: ["brake", "Bremse", "frein"],
  at_most: ["Drive at most", "Höchstens", "Ne pas dépasser"],
  slow_to: ["Slow down to", "Reduzieren auf", "Ralentir à"],
  soon: ["in", "in", "dans"],
  to_stop: ["to the stop", "bis zum Halt", "jusqu’à l’arrêt"],
  beyond: ["beyond the stop", "hinter dem Halt", "après l’arrêt"],
  limit: ["Limit", "Vmax", "Limite"],
  stop: ["Stop", "Halt", "Arrêt"],
  signal: ["Signal at danger", "Signal auf Halt", "Signal fermé"],
  wait: ["Wait", "Warten", "Attendre"],
  wait_why: ["No power before", "Keine Zugkraft vor", "Pas de traction avant"],
  too_fast: ["Too fast", "Zu schnell", "Trop vite"],
  depart: ["Depart", "Abfahren", "Partir"],
  depart_why: ["Doors closed, signal clear", "Türen geschlossen, Signal auf Fahrt", "Portes fermées, signal ouvert"],
  clear: ["Line clear", "Freie Fahrt", "Voie libre"],
  stopped: ["Stopped", "Steht", "À l’arrêt"],
  braked: ["Braked", "Zwangs\u00adbremsung", "Train freiné"],
  braked_why: [
    "The connection was lost. When the train stands and the lever is at 0, you may drive on.",
    "Die Verbindung war unterbrochen. Wenn der Zug steht und der Hebel auf 0 ist, dürfen Sie weiterfahren.",
    "La connexion a été perdue. Quand le train est arrêté et le manipulateur à 0, vous pouvez repartir.",
  ],
  was_braked: ["The train was braked", "Der Zug wurde gebremst", "Le train a été freiné"],
  was_braked_why: [
    "The connection was lost. You may drive on.",
    "Die Verbindung war unterbrochen. Sie dürfen weiterfahren.",
    "La connexion a été perdue. Vous pouvez repartir.",
  ],
  lever: ["Lever for power and brake", "Hebel für Zugkraft und Bremse", "Manipulateur de traction et de frein"],
  pwr: ["POWER", "ZUGKRAFT", "TRACTION"],
  brk: ["BRAKE", "BREMSE", "FREIN"],
  friction: ["air", "Luft", "air"],
  welcome: [
    "Drive this train, and arrive on time at each stop. Never exceed the limit: it is the white line. Before a stop " +
    "the metres count down to 0. Stop no more than {m} m before or beyond it.\n" +
    "Advice is violet and saves energy. Violet triangles show the advised speed and the advised place of the lever. " +
    "Advice never exceeds the limit. Without advice, keep to the limits and the timetable.",
    "Sie fahren diesen Zug und sollen an jedem Halt pünktlich ankommen. Überschreiten Sie nie die " +
    "Höchstgeschwindigkeit (Vmax): Sie ist die weisse Linie. Vor einem Halt zählt die Anzeige die Meter bis 0 " +
    "herunter. Halten Sie höchstens {m} m vor oder hinter diesem Punkt an.\n" +
    "Empfehlungen sind violett und sparen Energie. Violette Dreiecke zeigen die empfohlene Geschwindigkeit und die " +
    "empfohlene Stellung des Hebels. Eine Empfehlung liegt nie über der Höchstgeschwindigkeit. Ohne Empfehlung " +
    "beachten Sie Höchstgeschwindigkeit und Fahrplan.",
    "Vous conduisez ce train. Arrivez à l’heure à chaque arrêt. Ne dépassez jamais la vitesse limite : c’est la ligne " +
    "blanche. Avant un arrêt, les mètres sont décomptés jusqu’à 0. Arrêtez-vous au plus {m} m avant ou après ce " +
    "point.\n" +
    "Les conseils sont en violet et font économiser de l’énergie. Les triangles violets indiquent la vitesse " +
    "conseillée et la position conseillée du manipulateur. Un conseil ne dépasse jamais la vitesse limite. Sans " +
    "conseil, respectez les limites et l’horaire.",
  ],
  signs: [
    "White line: the limit. Violet: advice; triangles show the advised speed and place of the lever. Before a stop the " +
    "metres count down to 0.",
    "Weisse Linie: Höchstgeschwindigkeit (Vmax). Violett: Empfehlung; Dreiecke zeigen die empfohlene Geschwindigkeit " +
    "und Stellung des Hebels. Vor einem Halt zählt die Anzeige die Meter bis 0 herunter.",
    "Ligne blanche : vitesse limite. Violet : conseil ; les triangles indiquent la vitesse et la position du " +
    "manipulateur conseillées. Avant un arrêt, les mètres sont décomptés jusqu’à 0.",
  ],
  ready: ["I am ready", "Ich bin bereit", "Commencer"],
  preparing: ["The train is being prepared …", "Der Zug wird vorbereitet …", "Préparation du train …"],
  over: ["Arrived", "Angekommen", "Arrivé"],
  over_why: [
    "Thank you. The drive is recorded.",
    "Danke. Die Fahrt ist aufgezeichnet.",
    "Merci. Le trajet est enregistré.",
  ],
  stood_before: [
    "You stopped {m} m before the stopping point.",
    "Sie haben {m} m vor dem Halteort angehalten.",
    "Arrêt {m} m avant le point d’arrêt.",
  ],
  stood_beyond: [
    "You stopped {m} m beyond the stopping point.",
    "Sie haben {m} m hinter dem Halteort angehalten.",
    "Arrêt {m} m après le point d’arrêt.",
  ],
  broken: ["The drive was ended", "Die Fahrt wurde beendet", "Le trajet a été interrompu"],
  broken_why: [
    "The recording up to here is kept. Please ask the person who started the drive.",
    "Die Aufzeichnung bis hierher bleibt. Bitte wenden Sie sich an die Person, die die Fahrt gestartet hat.",
    "L’enregistrement jusqu’ici est conservé. Adressez-vous à la personne qui a lancé le trajet.",
  ],
  lost: ["Connection lost", "Verbindung verloren", "Connexion perdue"],
  lost_why: [
    "Trying again … The train is braked to a stand. Then, with the lever at 0, you may drive on.",
    "Neuer Versuch … Der Zug wird bis zum Stillstand gebremst. Dann dürfen Sie mit dem Hebel auf 0 weiterfahren.",
    "Nouvel essai … Le train est freiné jusqu’à l’arrêt. Ensuite, manipulateur à 0, vous pourrez repartir.",
  ],
  train: ["Train", "Zug", "Train"],
  no_silent: [
    "Nothing has been received from this train for 10 s.",
    "Von diesem Zug wurde seit 10 s nichts empfangen.",
    "Rien n’a été reçu de ce train depuis 10 s.",
  ],
  no_journey: [
    "No journey has been received for this train yet.",
    "Für diesen Zug wurde noch keine Fahrt empfangen.",
    "Aucun trajet de ce train n’a encore été reçu.",
  ],
  no_line: [
    "Its journey is for another line or train than this page was started with.",
    "Seine Fahrt gilt für eine andere Strecke oder einen anderen Zug, als für diese Seite angegeben sind.",
    "Son trajet concerne une autre ligne ou un autre train que ceux indiqués pour cette page.",
  ],
  no_position: [
    "No position has been received from this train yet.",
    "Von diesem Zug wurde noch keine Position empfangen.",
    "Aucune position de ce train n’a encore été reçue.",
  ],
  others: ["Trains with advice:", "Züge mit Empfehlungen:", "Trains avec conseils :"],
  connecting: ["Connecting …", "Verbindung wird aufgebaut …", "Connexion …"],
  taken: [
    "The desk is open in another window",
    "Das Pult ist in einem anderen Fenster offen",
    "Le pupitre est ouvert dans une autre fenêtre",
  ],
  taken_why: [
    "Drive there, or reload this page to drive here.",
    "Fahren Sie dort, oder laden Sie diese Seite neu, um hier zu fahren.",
    "Conduisez là-bas, ou rechargez cette page pour conduire ici.",
  ],
  k_up: ["more power, less brake", "mehr Zugkraft, weniger Bremse", "plus de traction, moins de frein"],
  k_down: ["more brake, less power", "mehr Bremse, weniger Zugkraft", "plus de frein, moins de traction"],
  k_zero: ["no power, no brake", "weder Zugkraft noch Bremse", "ni traction ni frein"],
  k_full: ["full brake", "Vollbremsung", "freinage maximal"],
  k_zoom: ["show less / more of the way", "kürzere / längere Strecke zeigen", "voir moins / plus loin"],
  k_sound: ["sound", "Ton", "son"],
  k_language: ["language", "Sprache", "langue"],
  k_mark: ["mark this moment", "diesen Moment markieren", "marquer ce moment"],
  k_pointer: [
    "drag the lever, or use a gamepad",
    "Hebel ziehen oder Gamepad benutzen",
    "faire glisser le manipulateur ou manette",
  ],
  step_consent: ["Consent", "Einwilligung", "Consentement"],
  step_instructions: ["Instructions", "Anleitung", "Instructions"],
  step_practice: ["Practice", "Übungsfahrt", "Trajet d’entraînement"],
  step_trial: ["Next trip", "Nächste Fahrt", "Trajet suivant"],
  step_break: ["Break", "Pause", "Pause"],
  step_debriefing: ["About this study", "Zu dieser Studie", "À propos de cette étude"],
  step_end: ["Thank you", "Vielen Dank", "Merci"],
  goodbye: ["You can close this page.", "Sie können diese Seite schliessen.", "Vous pouvez fermer cette page."],
  quit: ["Stop taking part", "Teilnahme beenden", "Arrêter de participer"],
  really: ["Stop taking part?", "Teilnahme wirklich beenden?", "Arrêter de participer\u00a0?"],
  really_why: [
    "You need no reason. The session ends here and cannot be resumed. You can ask for the deletion of your data.",
    "Sie brauchen keinen Grund. Die Sitzung endet hier und kann nicht fortgesetzt werden. Sie können die Löschung " +
    "Ihrer Daten verlangen.",
    "Vous n’avez pas à donner de raison. La session se termine ici et ne peut pas être reprise. Vous pouvez demander " +
    "l’effacement de vos données.",
  ],
  stay: ["Go on", "Weitermachen", "Continuer"],
  agree: ["I agree and take part", "Ich bin einverstanden", "J’accepte et je participe"],
  refuse: ["I do not take part", "Ich nehme nicht teil", "Je ne participe pas"],
  next: ["Continue", "Weiter", "Continuer"],
  optional: ["may be left out", "kann leer bleiben", "facultatif"],
  choose: ["Please choose an answer.", "Bitte wählen Sie eine Antwort.", "Veuillez choisir une réponse."],
  write: ["Please write an answer.", "Bitte schreiben Sie eine Antwort.", "Veuillez écrire une réponse."],
  trial: ["Trip {n} of {m}", "Fahrt {n} von {m}", "Trajet {n} sur {m}"],
  trials_done: ["{n} of {m} trips done", "{n} von {m} Fahrten gemacht", "{n} trajets sur {m} effectués"],
  break_left: ["You can go on in {m}.", "Sie können in {m} weitermachen.", "Vous pourrez continuer dans {m}."],
  break_over: [
    "The break is over. Go on when you are ready.",
    "Die Pause ist vorbei. Machen Sie weiter, wenn Sie bereit sind.",
    "La pause est terminée. Continuez quand vous êtes prêt.",
  ],
  lost_kept: [
    "The connection is lost. Trying again … Your answers are kept.",
    "Die Verbindung ist unterbrochen. Neuer Versuch … Ihre Antworten bleiben erhalten.",
    "La connexion est perdue. Nouvel essai … Vos réponses sont conservées.",
  ],
  press: ["press", "drücken", "appuyer"],
  pedal: ["press when asked", "auf Aufforderung drücken", "appuyer sur demande"],
  detection: [
    "press when a white disc appears",
    "drücken, wenn ein weisser Kreis erscheint",
    "appuyer quand un disque blanc apparaît",
  ],
  play: ["Play", "Abspielen", "Lecture"],
  pause: ["Pause", "Pause", "Pause"],
  before: ["Previous bookmark", "Vorheriges Lesezeichen", "Signet précédent"],
  after: ["Next bookmark", "Nächstes Lesezeichen", "Signet suivant"],
  pace: ["Speed of the replay", "Tempo der Wiedergabe", "Vitesse de lecture"],
  place: ["Moment of the drive", "Moment der Fahrt", "Moment du trajet"],
};

// The words of rows by language.
export const spoken = (rows) =>
  Object.fromEntries(
    LANGUAGES.map((lang, i) => [lang, Object.fromEntries(Object.entries(rows).map(([key, words]) => [key, words[i]]))]),
  );
export const WORDS = spoken(ROWS);
