// Drawing on canvases. Every function takes plain numbers (m, m/s, s) and has no state.
export const KMH = 3.6;
export const clamp = (value, low, high) => Math.min(Math.max(value, low), high);
// The colours of the style sheet by their names: C.advice is --advice.
const style = getComputedStyle(document.documentElement);
const C = new Proxy({}, { get: (known, name) => known[name] ||= style.getPropertyValue(`--${name}`) });
const TURN = 2 * Math.PI;

// A canvas's context, cleared and scaled to its box, with the box's width and height.
function surface(canvas) {
  const ratio = Math.min(devicePixelRatio || 1, 2);
  const wide = canvas.clientWidth, tall = canvas.clientHeight;
  const w = Math.round(wide * ratio), h = Math.round(tall * ratio);
  if (canvas.width !== w || canvas.height !== h) {
    canvas.width = w;
    canvas.height = h;
  }
  const g = canvas.getContext("2d");
  g.setTransform(ratio, 0, 0, ratio, 0, 0);
  g.clearRect(0, 0, wide, tall);
  return [g, wide, tall];
}

function font(g, size, weight = 400) {
  g.font = `${weight} ${size}px B612, system-ui, "DejaVu Sans", sans-serif`;
}

function text(g, words, x, y, size, color, align = "left", weight = 400) {
  font(g, size, weight);
  g.fillStyle = color;
  g.textAlign = align;
  g.textBaseline = "middle";
  g.fillText(words, x, y);
}

function trace(g, points) {
  g.beginPath();
  points.forEach(([x, y]) => g.lineTo(x, y));
}

function stroke(g, color, width) {
  g.strokeStyle = color;
  g.lineWidth = width;
  g.stroke();
}

function line(g, points, color, width, dash = []) {
  g.setLineDash(dash);
  g.lineJoin = "round";
  trace(g, points);
  stroke(g, color, width);
  g.setLineDash([]);
}

function polygon(g, points, color) {
  g.fillStyle = color;
  trace(g, points);
  g.closePath();
  g.fill();
}

function box(g, x, y, w, h, r, color) {
  g.fillStyle = color;
  g.beginPath();
  g.roundRect(x, y, w, h, r);
  g.fill();
}

function circle(g, x, y, r) {
  g.beginPath();
  g.arc(x, y, r, 0, TURN);
}

function disc(g, x, y, r, color) {
  circle(g, x, y, r);
  g.fillStyle = color;
  g.fill();
}

// The dial: 288 degrees. The limit is white, the speed grey; above the limit, band and needle are red.
// Advice is violet, and always a triangle.
export function dial(canvas, { v, shown, limit, top, advice, left, missed, words }) {
  const [g, w, h] = surface(canvas);
  const x = w / 2, y = h / 2 + 14, r = Math.min(w / 2 - 22, h / 2 - 22);
  const most = Math.ceil(top * KMH / 20) * 20 / KMH, over = v > limit + 0.5 / KMH;
  const angle = (speed) => 0.7 * Math.PI + 1.6 * Math.PI * clamp(speed / most, 0, 1);
  const polar = (radius, a) => [x + radius * Math.cos(a), y + radius * Math.sin(a)];
  const dot = (radius, speed) => polar(radius, angle(speed));
  const arc = (radius, from, to, width, color) => {
    g.beginPath();
    g.arc(x, y, radius, angle(from), angle(to));
    stroke(g, color, width);
  };
  arc(r, 0, most, 10, C.faint);
  arc(r, 0, limit, 10, C.band);
  if (over) arc(r, limit, v, 10, C.over);
  const named = most * KMH > 180 && r <= 150 ? 40 : 20;
  for (let kmh = 0; kmh <= most * KMH + 0.1; kmh += 10) {
    const speed = kmh / KMH, long = kmh % 20 === 0, color = speed > limit + 0.1 ? C.quiet : C.text;
    line(g, [dot(r - 12, speed), dot(r - (long ? 28 : 20), speed)], color, long ? 2.5 : 1.2);
    if (kmh % named === 0) text(g, `${kmh}`, ...dot(r - 49, speed), r > 150 ? 18 : 14, color, "center");
  }
  line(g, [dot(r + 7, limit), dot(r - 30, limit)], C.limit, 6);
  if (advice != null) {
    if (Math.abs(advice - v) > 0.4) arc(r - 12, Math.min(v, advice), Math.max(v, advice), 4, C.advice);
    const a = angle(advice);
    polygon(g, [polar(r - 9, a), polar(r + 16, a - 0.058), polar(r + 16, a + 0.058)], C.advice);
    stroke(g, C.panel, 2);
  }
  needle(g, x, y, r, angle(v), over ? C.over : C.grey);
  const size = r * (shown.length > 2 ? 0.234 : 0.27);
  text(g, shown, x, y + 2, size, over ? C.onred : C.ground, "center", 700);
  text(g, "km/h", x, y + r * 0.3 + 17, 14, C.soft, "center");
  if (left != null) lastMetres(g, x, y + r * 0.72, r, { left, missed, words });
}

function needle(g, x, y, r, angle, color) {
  const hub = r * 0.3;
  const side = [[hub - 2, 6], [r - 84, 5], [r - 74, 2.2], [r - 16, 2.2]];
  g.save();
  g.translate(x, y);
  g.rotate(angle);
  polygon(g, [...side.map(([along, across]) => [along, -across]), ...side.toReversed()], color);
  g.restore();
  disc(g, x, y, hub, color);
}

// In the gap of the dial: the last metres to the stop, the same for every presentation.
function lastMetres(g, x, y, r, { left, missed, words }) {
  const wide = r * 0.92, under = y + r * 0.235;
  text(g, `${Math.abs(Math.round(left))} m`, x, y, r * 0.17, missed ? C.over : C.text, "center", 700);
  text(g, left < -0.5 ? words.beyond : words.to_stop, x, y + r * 0.145, 14, C.soft, "center");
  box(g, x - wide / 2, under, wide, 6, 3, C.faint);
  box(g, x - wide / 2, under, wide * clamp(left / 300, 0, 1), 6, 3, C.text);
}

// The lever: power up, brake down. The white handle is its setting, the violet triangle the advised effort; red is the
// dead-man brake. The groove is orange where the electric brake is not sufficient. At the left, the train's efforts.
export function lever(canvas, { ratio, advised, notches, most, given, braked, words }) {
  const [g, w, h] = surface(canvas);
  const x = w / 2 + 14, top = 56, end = h - 56, mid = (top + end) / 2;
  const y = (setting) => mid - setting * (end - top) / 2;
  const [, electric, brakes] = most, motors = brakes > 0 ? electric / brakes : 1;
  box(g, x - 12, top - 6, 24, end - top + 12, 12, C.faint);
  if (motors < 0.99) {
    g.globalAlpha = 0.3;
    box(g, x - 12, y(-motors), 24, end + 6 - y(-motors), [0, 0, 12, 12], C.air);
    g.globalAlpha = 1;
    text(g, words.friction, x + 16, end + 16, 12, C.air);
  }
  const acts = braked ? -1 : ratio;
  box(g, x - 12, Math.min(y(acts), mid), 24, Math.abs(y(acts) - mid), 0, braked ? C.over : C.pull);
  scale(g, x, y, notches, h);
  text(g, words.pwr, w / 2, 24, 13, C.soft, "center");
  text(g, words.brk, w / 2, h - 24, 13, C.soft, "center");
  if (given) efforts(g, y, given, most);
  if (advised != null) {
    const at = y(clamp(advised, -1, 1));
    polygon(g, [[x + 16, at], [x + 34, at - 10], [x + 34, at + 10]], C.advice);
  }
  box(g, x - 24, y(ratio) - 12, 48, 24, 7, C.text);
  text(g, `${Math.round(Math.abs(ratio) * 100)}`, x, y(ratio) + 1, 14, C.ground, "center", 700);
}

function scale(g, x, y, notches, height) {
  const steps = notches || 10, every = height < 480 && steps > 5 ? 2 : 1;
  for (let i = -steps; i <= steps; i++) {
    const at = y(i / steps), long = i === 0 || Math.abs(i) === steps;
    line(g, [[x - (long ? 26 : 21), at], [x - 15, at]], i === 0 ? C.text : C.quiet, i === 0 ? 2.5 : 1.2);
    const percent = Math.round(100 * Math.abs(i) / steps);
    if (i && i % every === 0) text(g, `${percent}`, x - 30, at, 13, C.soft, "right");
  }
  text(g, "0", x - 30, y(0), 16, C.text, "right", 700);
}

// The train's efforts as shares of the largest ones: traction grey, electric brake blue, friction brake orange.
function efforts(g, y, [motors, friction], [traction, , brakes]) {
  const bar = (from, to, color) => line(g, [[9, y(from)], [9, y(to)]], color, 6);
  bar(1, -1, C.faint);
  if (motors > 0 && traction > 0) bar(0, Math.min(motors / traction, 1), C.pull);
  if (brakes <= 0) return;
  const electric = clamp(motors / brakes, -1, 0);
  if (electric < 0) bar(0, electric, C.electric);
  if (friction / brakes > -0.005) return;
  bar(electric, Math.max(electric + friction / brakes, -1), C.air);
}

// The line ahead: the train at the left, limits in white, gradients below; restrictions, stops, signals, and the next
// changes of the advice.
export function way(canvas, o) {
  const [g, w, h] = surface(canvas);
  const left = 58, right = w - 20, top = 40, base = h - 104, slope = h - 74, end = o.s + o.ahead;
  const fastest = Math.max(o.v, ...o.limits.filter(([s]) => s < end).map(([, v]) => v));
  const most = Math.ceil((fastest * KMH + 8) / 20) * 20;
  const x = (s) => left + (right - left) * (s - o.s) / o.ahead, y = (v) => base - (base - top) * v * KMH / most;
  const place = { g, left, right, top, base, slope, end, most, x, y };
  const inside = (...parts) => {
    g.save();
    g.beginPath();
    g.rect(left, 0, right - left + 1, h);
    g.clip();
    parts.forEach((part) => part(place, o));
    g.restore();
  };
  grid(place, o);
  inside(limits, restrictions, changes, stops, signal, gradients);
  polygon(g, [[left + 13, y(o.v)], [left - 3, y(o.v) - 8], [left - 3, y(o.v) + 8]], C.grey);
}

function grid({ g, left, right, top, base, most, x, y }, o) {
  for (let kmh = 0; kmh <= most; kmh += most > 120 ? 40 : 20) {
    const at = y(kmh / KMH);
    line(g, [[left, at], [right, at]], kmh ? C.faint : C.quiet, 1);
    text(g, `${kmh}`, left - 10, at, 14, C.soft, "right");
  }
  text(g, "km/h", left - 10, 16, 12, C.soft, "right");
  for (let quarter = 1; quarter <= 4; quarter++) {
    const m = o.ahead / 4 * quarter, at = x(o.s + m);
    const words = m >= 1000 ? `${(m / 1000).toLocaleString(o.lang)} km` : `${m} m`;
    line(g, [[at, top], [at, base]], C.faint, 1);
    text(g, words, Math.min(at, right - 16), base + 14, 13, C.soft, "center");
  }
}

function limits({ g, right, top, end, x, y }, o) {
  const steps = o.limits.filter(([s]) => s <= end + 1).flatMap(([s, v], i) => {
    const to = o.limits[i + 1]?.[0] ?? end + 1;
    return [[x(Math.max(s, o.s - 1)), y(v)], [x(Math.min(to, end + 1)), y(v)]];
  });
  if (steps.length) {
    polygon(g, [[steps[0][0], top], ...steps, [steps.at(-1)[0], top]], C.above);
    line(g, steps, C.limit, 2.5);
  }
  let last = -99;
  o.limits.forEach(([s, v], i) => {
    const at = x(s);
    if (!i || v === o.limits[i - 1][1] || at > right - 30 || at - last < 34) return;
    last = at;
    text(g, `${Math.round(v * KMH)}`, at + 5, y(v) - 12, 15, C.limit, "left", 700);
  });
}

function restrictions({ g, left, right, x, y }, o) {
  g.fillStyle = C.limit;
  for (const [from, to, v] of o.slow) {
    const end = Math.min(x(to), right) - 3;
    for (let at = Math.max(x(from), left) + 3; at < end; at += 9) g.fillRect(at, y(v) + 4, 4, 4);
  }
}

function changes({ g, left, right, top, base, x, y }, o) {
  line(g, o.path.map(([s, v]) => [x(s), y(v)]), C.advice, 3);
  for (const { way, mode, second } of o.changes) {
    const at = x(o.s + way);
    if (at > right - 4 || at < left) continue;
    line(g, [[at, top + 4], [at, base]], C.advice, second ? 1 : 1.8, [3, 5]);
    const middle = Math.max(at, left + 18);
    disc(g, middle, top, second ? 13 : 16, C.panel);
    stroke(g, C.advice, second ? 1.2 : 2);
    glyph(g, mode, middle, top, second ? 14 : 18, C.advice);
  }
}

function stops({ g, left, right, top, base, x }, o) {
  for (const [s, name] of o.stops) {
    const at = x(s);
    if (at < left || at > right + 40) continue;
    line(g, [[at, top + 20], [at, base]], C.text, 3);
    font(g, 16, 700);
    let shown = name;
    while (g.measureText(shown).width > (right - left) * 0.6) shown = `${shown.slice(0, -2)}…`;
    const wide = g.measureText(shown).width + 20;
    const begin = clamp(at - wide / 2, left + 2, right - wide);
    box(g, begin, base - 56, wide, 28, 6, C.text);
    text(g, shown, begin + wide / 2, base - 41.5, 16, C.ground, "center", 700);
  }
}

function signal({ g, left, base, x }, o) {
  if (o.signal == null || x(o.signal) < left) return;
  const at = x(o.signal);
  line(g, [[at, base], [at, base - 84]], C.grey, 3);
  box(g, at - 11, base - 112, 22, 34, 6, C.housing);
  disc(g, at, base - 101, 7, C.over);
  disc(g, at, base - 86, 5, C.dark);
}

function gradients({ g, left, right, slope, x }, o) {
  const mid = slope + 30;
  g.fillStyle = C.slope;
  g.fillRect(left, slope, right - left, 60);
  line(g, [[left, mid], [right, mid]], C.edge, 1);
  const steps = o.gradients.map(([s, ratio]) => [s, Math.round(ratio * 1000)]);
  const parts = steps.filter(([, permille], i) => !i || permille !== steps[i - 1][1]);
  parts.forEach(([s, permille], i) => {
    const begin = Math.max(x(s), left), end = i + 1 < parts.length ? Math.min(x(parts[i + 1][0]), right) : right;
    if (end <= begin) return;
    const tall = Math.min(Math.abs(permille), 25) / 25 * 26, up = permille > 0;
    g.fillStyle = up ? C.uphill : C.downhill;
    g.fillRect(begin, up ? mid - tall : mid, Math.max(end - begin - 1, 1), tall);
    if (end - begin < 54) return;
    const at = (begin + end) / 2, level = up ? mid + 15 : mid - 15;
    text(g, `${Math.abs(permille)} ‰`, at + (permille ? 7 : 0), level, 13, C.soft, "center");
    const point = up ? -4 : 4;
    if (permille) polygon(g, [[at - 29, level - point], [at - 19, level - point], [at - 24, level + point]], C.soft);
  });
}

const ARROW = [[0, -0.85], [0.8, 0.05], [0.3, 0.05], [0.3, 0.8], [-0.3, 0.8], [-0.3, 0.05], [-0.8, 0.05]];
const SIGNS = {
  traction: (g, color) => polygon(g, ARROW, color),
  brake: (g, color) => polygon(g, ARROW.map(([x, y]) => [x, -y]), color),
  hold: (g) => {
    g.fillRect(-0.8, -0.48, 1.6, 0.32);
    g.fillRect(-0.8, 0.16, 1.6, 0.32);
  },
  coast: (g, color) => {
    g.beginPath();
    g.moveTo(-0.85, -0.35);
    g.quadraticCurveTo(-0.1, -0.3, 0.8, 0.45);
    g.stroke();
    disc(g, -0.35, 0.35, 0.22, color);
  },
  stop: (g, color) => box(g, -0.6, -0.6, 1.2, 1.2, 0.12, color),
  depart: (g, color) => {
    circle(g, 0, 0, 0.72);
    g.stroke();
    polygon(g, [[-0.2, -0.36], [0.42, 0], [-0.2, 0.36]], color);
  },
  lateness: (g) => {
    circle(g, 0, 0, 0.72);
    g.stroke();
    trace(g, [[0, -0.4], [0, 0], [0.3, 0.2]]);
    g.stroke();
  },
  none: (g) => {
    trace(g, [[-0.5, 0], [0.5, 0]]);
    g.stroke();
  },
};
SIGNS.braked = SIGNS.brake;
SIGNS.top = SIGNS.hold;

// The sign of a kind of instruction, in a square of this size around a point; an unknown kind has that of no advice.
function glyph(g, kind, x, y, size, color) {
  g.save();
  g.translate(x, y);
  g.scale(size / 2, size / 2);
  g.fillStyle = g.strokeStyle = color;
  g.lineWidth = Math.max(2 / 9, 4 / size);
  g.lineCap = g.lineJoin = "round";
  (SIGNS[kind] ?? SIGNS.none)(g, color);
  g.restore();
}

export function sign(canvas, kind) {
  const [g, w, h] = surface(canvas), shown = kind !== "none";
  box(g, 2, 2, w - 4, h - 4, 14, kind === "braked" ? C.over : shown ? C.advice : C.button);
  glyph(g, kind, w / 2, h / 2, w * 0.62, shown ? C.onadvice : C.quiet);
}

export function lamp(canvas, open) {
  const [g, w, h] = surface(canvas);
  box(g, 4, 2, w - 8, h - 4, 12, C.housing);
  disc(g, w / 2, h * 0.3, 10, open ? C.dark : C.over);
  disc(g, w / 2, h * 0.7, 10, open ? C.go : C.dark);
}

// The bookmarks of a replay, as ticks along its slider.
export function ticks(canvas, places) {
  const [g, w, h] = surface(canvas);
  for (const share of places) {
    const x = 8 + share * (w - 16);
    line(g, [[x, 2], [x, h * 0.3]], C.advice, 2);
  }
}
