// Draws on canvases. Every function takes plain numbers (m, m/s, s) and draws; none keeps anything.
export const C = {
  ground: "#071320", panel: "#0d1d2e", edge: "#1d3247", text: "#eef4fa", soft: "#a9bccd", quiet: "#7f97ad", faint: "#17293b", band: "#4a6078",
  limit: "#ffffff", grey: "#c3c3c3", advice: "#c9a4ff", over: "#ff5a4f", go: "#7ee0c6", electric: "#6fb3d9", air: "#e0a458", pull: "#8fa9c2",
};
export const KMH = 3.6;
const font = (px, weight = 400) => `${weight} ${px}px B612, system-ui, "DejaVu Sans", sans-serif`;

// A canvas's context, cleared and scaled to its box, with the box's width and height.
export function surface(canvas) {
  const ratio = Math.min(devicePixelRatio || 1, 2), wide = canvas.clientWidth, tall = canvas.clientHeight;
  const w = Math.round(wide * ratio), h = Math.round(tall * ratio);
  if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
  const g = canvas.getContext("2d");
  g.setTransform(ratio, 0, 0, ratio, 0, 0);
  g.clearRect(0, 0, wide, tall);
  return [g, wide, tall];
}
function text(g, words, x, y, size, color, align = "left", weight = 400) {
  g.font = font(size, weight); g.fillStyle = color; g.textAlign = align; g.textBaseline = "middle"; g.fillText(words, x, y);
}
function line(g, points, color, width, dash = []) {
  g.strokeStyle = color; g.lineWidth = width; g.setLineDash(dash); g.lineJoin = "round"; g.beginPath();
  points.forEach(([x, y], i) => (i ? g.lineTo(x, y) : g.moveTo(x, y))); g.stroke(); g.setLineDash([]);
}
function box(g, x, y, w, h, r, color) { g.fillStyle = color; g.beginPath(); g.roundRect(x, y, w, h, r); g.fill(); }
function triangle(g, points, color) {
  g.fillStyle = color; g.beginPath(); points.forEach(([x, y], i) => (i ? g.lineTo(x, y) : g.moveTo(x, y))); g.closePath(); g.fill();
}

// The dial: 288 degrees. The limit is white, the speed grey; above the limit band and needle are red. Advice is violet, and always a triangle.
// In the gap below: the last metres to the stop, alike under every presentation.
export function dial(canvas, { v, shown, limit, top, advice, reach, left, words }) {
  const [g, w, h] = surface(canvas), x = w / 2, y = h / 2 + 14, r = Math.min(w / 2 - 22, h / 2 - 22);
  const most = Math.ceil(top * KMH / 20) * 20 / KMH, a0 = Math.PI * 0.7, span = Math.PI * 1.6;
  const at = (s) => a0 + span * Math.min(Math.max(s / most, 0), 1), over = v > limit + 0.5 / KMH;
  const dot = (rad, s) => [x + rad * Math.cos(at(s)), y + rad * Math.sin(at(s))];
  const arc = (rad, from, to, width, color) => { g.beginPath(); g.arc(x, y, rad, at(from), at(to)); g.lineWidth = width; g.strokeStyle = color; g.stroke(); };
  arc(r, 0, most, 10, C.faint); arc(r, 0, limit, 10, C.band);
  if (over) arc(r, limit, v, 10, C.over);
  const big = most * KMH > 180 ? 40 : 20;
  for (let k = 0; k <= most * KMH + 0.1; k += 10) {
    const s = k / KMH, beyond = s > limit + 0.1, long = k % 20 === 0;
    line(g, [dot(r - 12, s), dot(r - (long ? 28 : 20), s)], beyond ? C.quiet : C.text, long ? 2.5 : 1.2);
    if (long && (k % big === 0 || r > 150)) { const [tx, ty] = dot(r - 49, s); text(g, `${k}`, tx, ty, r > 150 ? 18 : 14, beyond ? C.quiet : C.text, "center"); }
  }
  line(g, [dot(r + 7, limit), dot(r - 30, limit)], C.limit, 6);
  if (advice != null) {
    if (Math.abs(advice - v) > 0.4) arc(r - 12, Math.min(v, advice), Math.max(v, advice), 4, C.advice);
    const c = at(advice), side = (rad, a) => [x + rad * Math.cos(a), y + rad * Math.sin(a)];
    triangle(g, [side(r - 9, c), side(r + 16, c - 0.058), side(r + 16, c + 0.058)], C.advice);
    g.lineWidth = 2; g.strokeStyle = C.panel; g.stroke();
  }
  if (reach != null) { const [rx, ry] = dot(r + 10, reach); g.beginPath(); g.arc(rx, ry, 4.5, 0, 7); g.lineWidth = 2.5; g.strokeStyle = C.advice; g.stroke(); }
  const color = over ? C.over : C.grey, hub = r * 0.3;
  g.save(); g.translate(x, y); g.rotate(at(v)); g.fillStyle = color; g.beginPath(); g.moveTo(hub - 2, -6);
  for (const [px, py] of [[r - 84, -5], [r - 74, -2.2], [r - 16, -2.2], [r - 16, 2.2], [r - 74, 2.2], [r - 84, 5], [hub - 2, 6]]) g.lineTo(px, py);
  g.fill(); g.restore();
  g.beginPath(); g.arc(x, y, hub, 0, 7); g.fillStyle = color; g.fill();
  text(g, shown, x, y + 2, hub * (shown.length > 2 ? 0.78 : 0.9), over ? "#2a0503" : C.ground, "center", 700);
  text(g, "km/h", x, y + hub + 17, 14, C.soft, "center");
  if (left == null) return;
  const wide = r * 0.92, ty = y + r * 0.72, share = Math.min(Math.max(left / 300, 0), 1);
  text(g, `${Math.abs(Math.round(left))} m`, x, ty, r * 0.17, left < -10 ? C.over : C.text, "center", 700);
  text(g, left < -0.5 ? words.beyond : words.to_stop, x, ty + r * 0.145, 14, C.soft, "center");
  box(g, x - wide / 2, ty + r * 0.235, wide, 6, 3, C.faint); box(g, x - wide / 2, ty + r * 0.235, Math.max(wide * share, 0), 6, 3, C.text);
}

// The lever: power up, brake down. A white handle is where it is set, a violet triangle the advised effort; red, the dead-man brake. At the left, what the train gives:
// traction grey, the electric brake blue, the friction brake orange. The friction brake also begins where the groove turns orange.
export function lever(canvas, { ratio, advised, notches, most, given, braked, words }) {
  const [g, w, h] = surface(canvas), x = w / 2 + 14, top = 56, end = h - 56, mid = (top + end) / 2, half = (end - top) / 2;
  const y = (q) => mid - q * half, [pull, electric, brakes] = most;
  box(g, x - 12, top - 6, 24, end - top + 12, 12, C.faint);
  const air = brakes > 0 ? electric / brakes : 1;
  if (air < 0.99) { g.globalAlpha = 0.3; box(g, x - 12, y(-air), 24, end + 6 - y(-air), [0, 0, 12, 12], C.air); g.globalAlpha = 1; }
  const acts = braked ? -1 : ratio;
  if (acts) { g.fillStyle = braked ? C.over : C.pull; g.fillRect(x - 12, Math.min(y(acts), mid), 24, Math.abs(y(acts) - mid)); }
  const steps = notches || 10, every = h < 480 && steps > 5 ? 2 : 1;
  for (let i = -steps; i <= steps; i++) {
    const q = i / steps, long = i === 0 || Math.abs(i) === steps;
    line(g, [[x - (long ? 26 : 21), y(q)], [x - 15, y(q)]], i === 0 ? C.text : C.quiet, i === 0 ? 2.5 : 1.2);
    if (i && i % every === 0) text(g, `${notches ? Math.abs(i) : Math.abs(i) * 10}`, x - 30, y(q), 13, C.soft, "right");
  }
  text(g, "0", x - 30, mid, 16, C.text, "right", 700);
  text(g, words.pwr, w / 2, 24, 13, C.soft, "center"); text(g, words.brk, w / 2, h - 24, 13, C.soft, "center");
  if (given) {
    const [el, fr] = given, bar = 14;
    line(g, [[bar, top], [bar, end]], C.faint, 6);
    if (el > 0 && pull > 0) line(g, [[bar, mid], [bar, y(Math.min(el / pull, 1))]], C.pull, 6);
    const e = brakes > 0 ? Math.max(el, -brakes) / brakes : 0, f = brakes > 0 ? fr / brakes : 0;
    if (e < 0) line(g, [[bar, mid], [bar, y(Math.max(e, -1))]], C.electric, 6);
    if (f < -0.005) { line(g, [[bar, y(Math.max(Math.min(e, 0), -1))], [bar, y(Math.max(Math.min(e, 0) + f, -1))]], C.air, 6); text(g, words.friction, 6, end + 14, 12, C.air); }
  }
  if (advised != null) { const q = y(Math.min(Math.max(advised, -1), 1)); triangle(g, [[x + 16, q], [x + 34, q - 10], [x + 34, q + 10]], C.advice); }
  box(g, x - 24, y(ratio) - 12, 48, 24, 7, C.text);
  text(g, `${Math.round(Math.abs(ratio) * 100)}`, x, y(ratio) + 1, 14, C.ground, "center", 700);
}

// The way ahead: the limits in white, the train at the left, gradients below; stops, signals, restrictions, and the next changes of the advice.
export function way(canvas, o) {
  const [g, w, h] = surface(canvas), left = 58, right = w - 20, slope = h - 74, base = h - 104, top = 40;
  const X = (s) => left + (right - left) * (s - o.s) / o.ahead, end = o.s + o.ahead;
  const most = Math.ceil((Math.max(...o.limits.filter(([s]) => s < end).map(([, v]) => v), o.v) * KMH + 8) / 20) * 20, Y = (v) => base - (base - top) * v * KMH / most;
  const inside = (draw) => { g.save(); g.beginPath(); g.rect(left, 0, right - left + 1, h); g.clip(); draw(); g.restore(); };
  inside(() => { for (const [from, length] of o.tunnels) { g.fillStyle = "#132539"; g.fillRect(X(from), top, X(from + length) - X(from), base - top); } });
  for (let k = 0; k <= most; k += most > 120 ? 40 : 20) { line(g, [[left, Y(k / KMH)], [right, Y(k / KMH)]], k ? C.faint : C.quiet, 1); text(g, `${k}`, left - 10, Y(k / KMH), 14, C.soft, "right"); }
  text(g, "km/h", left - 10, 16, 12, C.soft, "right");
  for (let i = 1; i <= 4; i++) { const m = o.ahead / 4 * i; line(g, [[X(o.s + m), top], [X(o.s + m), base]], C.faint, 1); text(g, m >= 1000 ? `${(m / 1000).toLocaleString(o.lang)} km` : `${m} m`, Math.min(X(o.s + m), right - 16), base + 14, 13, C.soft, "center"); }
  inside(() => {
    const steps = [];
    o.limits.forEach(([s, v], i) => { const to = i + 1 < o.limits.length ? o.limits[i + 1][0] : end + 1; if (s <= end + 1) steps.push([X(Math.max(s, o.s - 1)), Y(v)], [X(Math.min(to, end + 1)), Y(v)]); });
    if (steps.length) {
      g.fillStyle = "rgb(255 255 255 / .05)"; g.beginPath(); g.moveTo(steps[0][0], top); steps.forEach(([a, b]) => g.lineTo(a, b)); g.lineTo(steps.at(-1)[0], top); g.closePath(); g.fill();
      line(g, steps, C.limit, 2.5);
    }
    let last = -99;
    o.limits.forEach(([s, v], i) => {
      const lx = X(s); if (!i || v === o.limits[i - 1][1] || lx > right - 30 || lx - last < 34) return;
      last = lx; text(g, `${Math.round(v * KMH)}`, lx + 5, Y(v) - 12, 15, C.limit, "left", 700);
    });
    for (const [from, to, v] of o.slow) { g.fillStyle = C.limit; for (let x = Math.max(X(from), left) + 3; x < Math.min(X(to), right) - 3; x += 9) g.fillRect(x, Y(v) + 4, 4, 4); }
    if (o.path.length) line(g, o.path.map(([s, v]) => [X(s), Y(v)]), C.advice, 3);
    for (const change of o.changes) {
      const cx = X(o.s + change.way); if (cx > right - 4 || cx < left + 18) continue;
      line(g, [[cx, top + 4], [cx, base]], C.advice, change.second ? 1 : 1.8, [3, 5]);
      g.beginPath(); g.arc(cx, top, change.second ? 13 : 16, 0, 7); g.fillStyle = C.panel; g.fill(); g.strokeStyle = C.advice; g.lineWidth = change.second ? 1.2 : 2; g.stroke();
      glyph(g, change.mode, cx, top, change.second ? 14 : 18, C.advice);
    }
    for (const [s, name] of o.stops) {
      const sx = X(s); if (sx < left || sx > right + 40) continue;
      line(g, [[sx, top + 20], [sx, base]], C.text, 3); g.font = font(16, 700);
      let shown = name; while (g.measureText(shown).width > (right - left) * 0.6) shown = `${shown.slice(0, -2)}…`;
      const wide = g.measureText(shown).width + 20, bx = Math.min(Math.max(sx - wide / 2, left + 2), right - wide);
      box(g, bx, base - 56, wide, 28, 6, C.text); text(g, shown, bx + wide / 2, base - 41.5, 16, C.ground, "center", 700);
    }
    if (o.signal != null && X(o.signal) >= left) {
      const sx = X(o.signal); line(g, [[sx, base], [sx, base - 84]], C.grey, 3); box(g, sx - 11, base - 112, 22, 34, 6, "#03080d");
      g.fillStyle = C.over; g.beginPath(); g.arc(sx, base - 101, 7, 0, 7); g.fill(); g.fillStyle = "#24323f"; g.beginPath(); g.arc(sx, base - 86, 5, 0, 7); g.fill();
    }
    g.fillStyle = "#112336"; g.fillRect(left, slope, right - left, 60); line(g, [[left, slope + 30], [right, slope + 30]], C.edge, 1);
    const parts = [];
    for (const [s, i] of o.gradients) { const mil = Math.round(i * 1000); if (!parts.length || parts.at(-1)[1] !== mil) parts.push([s, mil]); }
    parts.forEach(([s, mil], k) => {
      const a = Math.max(X(s), left), b = Math.min(k + 1 < parts.length ? X(parts[k + 1][0]) : right, right); if (b <= a) return;
      const tall = Math.min(Math.abs(mil), 25) / 25 * 26, mx = (a + b) / 2;
      g.fillStyle = mil > 0 ? "#5b7894" : "#3a5876"; if (mil) g.fillRect(a, mil > 0 ? slope + 30 - tall : slope + 30, Math.max(b - a - 1, 1), tall);
      if (b - a < 54) return;
      const ty = mil > 0 ? slope + 45 : mil < 0 ? slope + 15 : slope + 15; text(g, `${Math.abs(mil)} ‰`, mx + (mil ? 7 : 0), ty, 13, C.soft, "center");
      if (mil) { const d = mil > 0 ? -4 : 4, px = mx - 24; triangle(g, [[px - 5, ty - d], [px + 5, ty - d], [px, ty + d]], C.soft); }
    });
  });
  triangle(g, [[left + 13, Y(o.v)], [left - 3, Y(o.v) - 8], [left - 3, Y(o.v) + 8]], C.grey);
}

// The signs of the modes: traction, hold, coast, brake, stop, depart.
export function glyph(g, mode, x, y, size, color) {
  const u = size / 2, arrow = (d) => triangle(g, [[0, -d * u * 0.85], [u * 0.8, d * u * 0.05], [u * 0.3, d * u * 0.05], [u * 0.3, d * u * 0.8], [-u * 0.3, d * u * 0.8], [-u * 0.3, d * u * 0.05], [-u * 0.8, d * u * 0.05]], color);
  g.save(); g.translate(x, y); g.fillStyle = color; g.strokeStyle = color; g.lineWidth = Math.max(size / 9, 2); g.lineCap = "round"; g.lineJoin = "round"; g.beginPath();
  if (mode === "traction") arrow(1);
  else if (mode === "brake" || mode === "braked") arrow(-1);
  else if (mode === "hold" || mode === "top") { g.fillRect(-u * 0.8, -u * 0.48, u * 1.6, u * 0.32); g.fillRect(-u * 0.8, u * 0.16, u * 1.6, u * 0.32); }
  else if (mode === "coast") { g.moveTo(-u * 0.85, -u * 0.35); g.quadraticCurveTo(-u * 0.1, -u * 0.3, u * 0.8, u * 0.45); g.stroke(); g.beginPath(); g.arc(-u * 0.35, u * 0.35, u * 0.22, 0, 7); g.fill(); }
  else if (mode === "stop") { g.roundRect(-u * 0.6, -u * 0.6, u * 1.2, u * 1.2, 3); g.fill(); }
  else if (mode === "depart") { g.arc(0, 0, u * 0.72, 0, 7); g.stroke(); triangle(g, [[-u * 0.2, -u * 0.36], [u * 0.42, 0], [-u * 0.2, u * 0.36]], color); }
  else if (mode === "deviation") { g.arc(0, 0, u * 0.72, 0, 7); g.stroke(); g.beginPath(); g.moveTo(0, -u * 0.4); g.lineTo(0, 0); g.lineTo(u * 0.3, u * 0.2); g.stroke(); }
  else { g.moveTo(-u * 0.5, 0); g.lineTo(u * 0.5, 0); g.stroke(); }
  g.restore();
}
export function sign(canvas, mode) {
  const [g, w, h] = surface(canvas), braked = mode === "braked", shown = mode !== "none";
  box(g, 2, 2, w - 4, h - 4, 14, braked ? C.over : shown ? C.advice : "#16293d");
  glyph(g, mode, w / 2, h / 2, w * 0.62, shown ? "#170b2b" : C.quiet);
}
export function lamp(canvas, open) {
  const [g, w, h] = surface(canvas);
  box(g, 4, 2, w - 8, h - 4, 12, "#03080d");
  for (const [on, y, color] of [[!open, 0.3, C.over], [open, 0.7, C.go]]) { g.fillStyle = on ? color : "#14222f"; g.beginPath(); g.arc(w / 2, h * y, 10, 0, 7); g.fill(); }
}
// The bookmarks of a replay, as ticks along its slider.
export function ticks(canvas, places) {
  const [g, w, h] = surface(canvas);
  for (const q of places) line(g, [[8 + q * (w - 16), 2], [8 + q * (w - 16), h * 0.3]], C.advice, 2);
}
