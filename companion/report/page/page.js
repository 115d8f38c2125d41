"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const flights = data.flights, zero = [...new Set(data.flights.map((f) => f.zero))].join(" or "), main = document.getElementById("main"), root = document.documentElement;
main.style.setProperty("--flights", flights.length);
const el = (tag, attributes = {}, ...children) => {
  const made = document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
};
const unpack = (text) => new Float32Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
const column = (text) => Array.from(unpack(text), (v) => (Number.isFinite(v) ? v : null));
const colour = (name) => getComputedStyle(root).getPropertyValue("--" + name).trim();
const shown = (v) => (v == null ? "–" : Math.abs(v) >= 1e5 || (v && Math.abs(v) < 1e-3) ? v.toExponential(2) : String(+v.toPrecision(4)));
if (matchMedia("(prefers-color-scheme: dark)").matches) root.classList.add("dark");

const row = (...children) => { const made = el("div", { class: "row" }, ...children); main.append(made); return made; };
const table = (caption, heads, rows, numbers) => el("div", { class: "wide", tabindex: 0, role: "region", "aria-label": caption },
  el("table", {}, el("caption", { hidden: "" }, caption),
    el("thead", {}, el("tr", {}, ...heads.map((h, i) => el("th", { scope: "col", class: numbers.includes(i) ? "n" : "" }, h)))),
    el("tbody", {}, ...rows.map((cells) => el("tr", {}, ...cells.map((c, i) => el("td", { class: numbers.includes(i) ? "n" : "" }, String(c))))))));

// --- verdicts, and the comparison --------------------------------------------------------------------------------
row(...flights.map((f) => {
  const made = el("section", { class: "verdict", "aria-label": "Verdict on " + f.name }, el("h2", {}, f.name), el("p", { class: "kind" }, f.kind));
  for (const [heading, lines] of f.verdict) made.append(el("h3", {}, heading), el("ul", {}, ...lines.map((l) => el("li", {}, l))));
  return made;
}));
if (flights.length > 1) {
  const names = [...new Set(flights.flatMap((f) => f.facts.map((fact) => fact[0])))];
  const rows = names.map((name) => {
    const found = flights.map((f) => f.facts.find((fact) => fact[0] === name));
    const [first, ...others] = found.map((fact) => (fact ? fact[1] : null));
    const unit = found.find(Boolean)[2];
    return [`${name}, ${unit}`, shown(first), ...others.flatMap((v) => [shown(v), v == null || !first ? "–" : `${((v / first - 1) * 100).toFixed(1)} %`])];
  });
  main.append(el("h2", {}, "Side by side"), table("Figures of the flights side by side",
    ["quantity", flights[0].name, ...flights.slice(1).flatMap((f) => [f.name, "difference"])], rows, rows[0].map((_, i) => i).slice(1)));
}

// --- the path in 3-D, with replay --------------------------------------------------------------------------------
const paths = flights.map((f) => f.path && f.path.map(unpack));
let turn = 0.7, lift = 0.5, zoom = 1, now = 0;
const [began, ended] = paths.filter(Boolean).reduce(([a, b], p) => [Math.min(a, p[0][0]), Math.max(b, p[0][p[0].length - 1])], [Infinity, -Infinity]);
const canvases = [];
if (paths.some(Boolean)) {
  main.append(el("h2", {}, "Path"));
  row(...flights.map((f, i) => {
    if (!paths[i]) return el("p", { class: "missing" }, "No path is recorded.");
    const canvas = el("canvas", { class: "path", tabindex: 0, role: "img", "aria-label": `Path of ${f.name} in space, north, east and height in metres. Arrow keys turn it, + and - zoom.` });
    canvases.push([canvas, paths[i]]);
    canvas.addEventListener("pointermove", (e) => { if (e.buttons) { turn -= e.movementX / 150; lift = Math.min(1.57, Math.max(0, lift + e.movementY / 150)); drawPaths(); } });
    canvas.addEventListener("keydown", (e) => {
      const step = { ArrowLeft: () => (turn += 0.1), ArrowRight: () => (turn -= 0.1), ArrowUp: () => (lift = Math.min(1.57, lift + 0.1)), ArrowDown: () => (lift = Math.max(0, lift - 0.1)), "+": () => (zoom *= 1.2), "-": () => (zoom /= 1.2) }[e.key];
      if (step) { step(); e.preventDefault(); drawPaths(); }
    });
    return el("figure", { class: "panel", "data-panel": "path" }, el("figcaption", {}, "Path in space; the stick is the thrust's direction"), canvas, el("p", { class: "kind where", role: "status" }));
  }));
  const play = el("button", { type: "button", id: "play", "aria-pressed": "false" }, "Play");
  const slider = el("input", { type: "range", id: "slider", min: began, max: ended, step: 0.05, value: began, "aria-label": "Time of the replay, seconds from " + zero });
  const speed = el("select", { "aria-label": "Speed of the replay" }, ...[1, 4, 16].map((n) => el("option", { value: n }, n + " ×")));
  main.append(el("div", { class: "replay" }, play, slider, speed));
  now = began;
  let last = 0;
  const tick = (at) => {
    if (play.getAttribute("aria-pressed") !== "true") return;
    now = Math.min(ended, now + Math.max(0, at - last) * 1e-3 * speed.value);
    last = at;
    slider.value = now;
    drawPaths();
    if (now >= ended) stop(); else requestAnimationFrame(tick);
  };
  const stop = () => { play.setAttribute("aria-pressed", "false"); play.textContent = "Play"; };
  play.addEventListener("click", () => {
    if (play.getAttribute("aria-pressed") === "true") return stop();
    if (now >= ended) now = began;
    play.setAttribute("aria-pressed", "true"); play.textContent = "Pause";
    last = performance.now();
    requestAnimationFrame(tick);
  });
  slider.addEventListener("input", () => { now = +slider.value; drawPaths(); });
}
function drawPaths() {
  for (const [canvas, [t, at, wanted, up]] of canvases) {
    const ratio = devicePixelRatio || 1, w = canvas.clientWidth, h = canvas.clientHeight, g = canvas.getContext("2d");
    canvas.width = w * ratio; canvas.height = h * ratio; g.scale(ratio, ratio);
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    for (const of of [at, wanted]) for (let i = 0; i < of.length; i++) { const k = i % 3, v = of[i]; if (Number.isFinite(v)) { low[k] = Math.min(low[k], v); high[k] = Math.max(high[k], v); } }
    const mid = low.map((v, k) => (v + high[k]) / 2), size = Math.max(0.5, Math.hypot(...low.map((v, k) => high[k] - v)));
    const scale = (0.85 * Math.min(w, h) * zoom) / size, ct = Math.cos(turn), st = Math.sin(turn), cl = Math.cos(lift), sl = Math.sin(lift);
    const flat = (n, e, d) => { n -= mid[0]; e -= mid[1]; d -= mid[2]; const a = e * ct - n * st, b = n * ct + e * st; return [w / 2 + scale * a, h / 2 - scale * (b * sl - d * cl)]; };
    const line = (role, width, dash, points) => { g.strokeStyle = colour(role); g.lineWidth = width; g.setLineDash(dash); g.beginPath(); let pen = false; for (const p of points) { if (!Number.isFinite(p[0] + p[1])) { pen = false; continue; } if (pen) g.lineTo(...p); else g.moveTo(...p); pen = true; } g.stroke(); g.setLineDash([]); };
    const all = (of) => Array.from({ length: t.length }, (_, i) => flat(of[3 * i], of[3 * i + 1], of[3 * i + 2]));
    const unit = 10 ** Math.floor(Math.log10(size)), step = size / unit > 5 ? 2 * unit : unit > size / 2 ? unit / 2 : unit, floor = high[2];
    const from = [0, 1].map((k) => Math.floor(low[k] / step) * step), to = [0, 1].map((k) => Math.ceil(high[k] / step) * step);
    for (let n = from[0]; n <= to[0] + 1e-9; n += step) line("line", 1, [], [flat(n, from[1], floor), flat(n, to[1], floor)]);
    for (let e = from[1]; e <= to[1] + 1e-9; e += step) line("line", 1, [], [flat(from[0], e, floor), flat(to[0], e, floor)]);
    g.fillStyle = colour("soft"); g.font = "12px system-ui";
    g.fillText(`north (grid ${+step.toPrecision(2)} m)`, ...flat(to[0], from[1], floor)); g.fillText("east", ...flat(from[0], to[1], floor));
    line("wanted", 1.5, [5, 4], all(wanted));
    const path = all(at);
    line("soft", 1, [], path);
    let i = 0;
    while (i < t.length - 1 && t[i + 1] <= now) i++;
    line("measured", 2.5, [], path.slice(0, i + 1));
    const arm = 0.12 * size, tip = flat(at[3 * i] + arm * up[3 * i], at[3 * i + 1] + arm * up[3 * i + 1], at[3 * i + 2] + arm * up[3 * i + 2]);
    line("limit", 3, [], [path[i], tip]);
    g.fillStyle = colour("limit"); g.beginPath(); g.arc(...path[i], 5, 0, 7); g.fill();
    canvas.parentElement.querySelector(".where").textContent = `${now.toFixed(1)} s: north ${shown(at[3 * i])} m, east ${shown(at[3 * i + 1])} m, height ${shown(-at[3 * i + 2])} m (set-point dashed)`;
  }
  for (const plot of plots) if (now >= plot.scales.x.min && now <= plot.scales.x.max) plot.redraw(false);
}

// --- panels --------------------------------------------------------------------------------------------------------
const plots = [], sync = uPlot.sync("flight");
let zooming = false;
const zoomAll = (min, max) => { if (zooming) return; zooming = true; for (const plot of plots) plot.setScale("x", { min, max }); zooming = false; };
const panelsOf = (id) => flights.map((f) => f.panels.find((p) => p.id === id));
const spanOf = () => flights.flatMap((f) => f.panels).reduce(([a, b], p) => (p.time.length ? [Math.min(a, p.first), Math.max(b, p.last)] : [a, b]), [Infinity, -Infinity]);
for (const p of flights.flatMap((f) => f.panels)) {
  p.time = column(p.time); p.columns = p.columns.map(column); p.first = p.time[0]; p.last = p.time[p.time.length - 1];
}
const whole = flights.flatMap((f) => f.panels).filter((p) => p.id.startsWith("position")).reduce(([a, b], p) => [Math.min(a, p.first), Math.max(b, p.last)], [Infinity, -Infinity]);
if (!Number.isFinite(whole[0])) whole.splice(0, 2, ...spanOf());
const heatColour = (share) => (share >= 1 ? colour("limit") : `color-mix(in srgb, ${colour(share >= 0.7 ? "ideal" : "band")} ${Math.round(100 * Math.max(0.06, share))}%, ${colour("bg")})`);
function drawHeat(plot, panel) {
  const g = plot.ctx, { left, top, width, height } = plot.bbox, n = panel.columns.length, t = panel.time, cell = height / n;
  g.save(); g.beginPath(); g.rect(left, top, width, height); g.clip();
  for (let k = 0; k < n; k++) for (let i = 0; i < t.length; i++) {
    const x0 = plot.valToPos(t[i], "x", true), x1 = plot.valToPos(i + 1 < t.length ? t[i + 1] : t[i] + 0.02, "x", true);
    if (x1 < left || x0 > left + width) continue;
    g.fillStyle = heatColour(panel.columns[k][i]);
    g.fillRect(x0, top + k * cell + 1, Math.max(1, x1 - x0 + 0.5), cell - 2);
  }
  g.restore();
}
function drawOver(plot, panel) {
  const g = plot.ctx, { left, top, width, height } = plot.bbox, ratio = devicePixelRatio || 1;
  if (panel.kind === "heat") drawHeat(plot, panel);
  g.save(); g.beginPath(); g.rect(left, top, width, height); g.clip();
  g.strokeStyle = g.fillStyle = colour("limit"); g.lineWidth = 1.5 * ratio; g.font = `${11 * ratio}px system-ui`; g.textAlign = "left"; g.textBaseline = "alphabetic";
  for (const [label, value] of panel.limits) {
    const y = plot.valToPos(value, "y", true);
    g.setLineDash([6 * ratio, 4 * ratio]); g.beginPath(); g.moveTo(left, y); g.lineTo(left + width, y); g.stroke();
    g.fillText(`${label} ${shown(value)}`, left + 6 * ratio, y + (y < top + 16 * ratio ? 13 : -4) * ratio);
  }
  g.setLineDash([]);
  if (canvases.length) { const x = plot.valToPos(now, "x", true); g.lineWidth = ratio; g.beginPath(); g.moveTo(x, top); g.lineTo(x, top + height); g.stroke(); }
  g.restore();
}
function range(id) { // the same for all flights, over what is shown at first
  let low = Infinity, high = -Infinity;
  for (const p of panelsOf(id)) if (p) {
    for (const c of p.columns) for (let i = 0; i < c.length; i++) if (c[i] !== null && p.time[i] >= whole[0] && p.time[i] <= whole[1]) { const v = c[i]; if (v < low) low = v; if (v > high) high = v; }
    const reach = high - low;
    for (const [, v] of p.limits) if (id.endsWith("-weight") || (v <= high + 2 * reach && v >= low - 2 * reach)) { low = Math.min(low, v); high = Math.max(high, v); }
  }
  if (!(high >= low)) return [0, 1];
  const pad = 0.06 * (high - low) || 0.05 * Math.abs(high) || 0.1;
  return [low - pad, high + pad];
}
function plotIn(host, panel) {
  const heat = panel.kind === "heat", stroke = () => colour("fg"), grid = { stroke: () => colour("line"), width: 1 };
  const [low, high] = heat ? [0, 1] : range(panel.id), n = panel.columns.length;
  const height = heat ? 60 + 21 * n : 210, narrow = host.clientWidth < 500;
  const value = (_, v) => shown(v), dashes = { wanted: [6, 3], reference: [8, 3, 2, 3], ideal: [2, 3] };
  const y = heat
    ? { scale: "y", stroke, size: narrow ? 128 : 175, gap: 4, font: "11px system-ui", grid: { show: false }, ticks: { show: false }, splits: () => panel.labels.map((_, k) => 1 - (k + 0.5) / n), values: () => panel.labels }
    : { scale: "y", stroke, grid, label: panel.unit === "1" ? "1 (no unit)" : panel.unit, labelSize: 20, size: 56, font: "11px system-ui", labelFont: "12px system-ui" };
  const plot = new uPlot({
    width: host.clientWidth, height, pxAlign: 0,
    scales: { x: { time: false, range: (u, a, b) => [a ?? whole[0], b ?? whole[1]] }, y: { range: () => [low, high] } },
    axes: [{ stroke, grid, label: `time from ${zero}, s`, labelSize: 18, size: 34, font: "11px system-ui", labelFont: "12px system-ui" }, y],
    series: [{ label: "s", value }, ...panel.labels.map((label, k) => heat
      ? { label, value, scale: "share", paths: () => null, points: { show: false } }
      : { label, value, stroke: () => colour(panel.roles[k]), width: panel.roles[k] === "band" ? 0.5 : 1.5, dash: dashes[panel.roles[k]], points: { show: false }, spanGaps: false })],
    bands: panel.band ? [{ series: [panel.band[0] + 1, panel.band[1] + 1], fill: () => colour("band") + "44" }] : [],
    cursor: { sync: { key: sync.key }, drag: { x: true, y: false } },
    legend: { show: !heat || !narrow },
    hooks: { draw: [(u) => drawOver(u, panel)], setScale: [(u, key) => { if (key === "x" && u.status) zoomAll(u.scales.x.min, u.scales.x.max); }] },
  }, [panel.time, ...panel.columns], host);
  plot.over.addEventListener("dblclick", () => zoomAll(...whole));
  host.addEventListener("keydown", (e) => {
    const { min, max } = plot.scales.x, mid = (min + max) / 2, half = (max - min) / 2, at = plot.cursor.left >= 0 ? plot.cursor.left : 0;
    const act = {
      ArrowLeft: () => plot.setCursor({ left: Math.max(0, at - 5), top: 20 }), ArrowRight: () => plot.setCursor({ left: Math.min(plot.over.clientWidth, at + 5), top: 20 }),
      "+": () => zoomAll(mid - half / 1.5, mid + half / 1.5), "-": () => zoomAll(Math.max(whole[0], mid - half * 1.5), Math.min(whole[1], mid + half * 1.5)), 0: () => zoomAll(...whole),
    }[e.key];
    if (act) { act(); e.preventDefault(); }
  });
  plots.push(plot);
  plot.host = host;
  host.dataset.drawn = "yes";
}
const described = (panel) => panel.labels.map((label, k) => {
  let low = Infinity, high = -Infinity;
  for (const v of panel.columns[k]) if (v !== null) { low = Math.min(low, v); high = Math.max(high, v); }
  return high >= low ? `${label} from ${shown(low)} to ${shown(high)}` : `${label}: nothing`;
}).join("; ");
const ids = [...new Set(flights.flatMap((f) => f.panels.map((p) => p.id)))];
if (ids.length) main.append(el("h2", {}, "Over time"));
const hosts = [];
for (const id of ids) row(...panelsOf(id).map((panel, i) => {
  if (!panel) return el("p", { class: "missing" }, `Not in ${flights[i].name}.`);
  const name = flights.length > 1 ? `${panel.title} (${flights[i].name})` : panel.title;
  const host = el("div", { class: "plot", tabindex: 0, role: "img", "aria-label": `${name}, ${panel.unit === "1" ? "no unit" : panel.unit}. ${described(panel)}.` });
  hosts.push([host, panel]);
  return el("figure", { class: "panel", "data-panel": id }, el("figcaption", {}, panel.title), host);
}));

// --- tables --------------------------------------------------------------------------------------------------------
main.append(el("h2", {}, "Guards, nearest to their limit first"));
row(...flights.map((f) => f.guards.length
  ? table("Guards of " + f.name, ["guard", "share", "at, s", "value", "limit", "unit"], f.guards.map(([g, s, t, v, l, u]) => [g, `${(100 * s).toFixed(0)} %`, shown(t), shown(v), shown(l), u]), [1, 2, 3, 4])
  : el("p", { class: "missing" }, "No guard's number is in it.")));
main.append(el("h2", {}, "Events"));
row(...flights.map((f) => table("Events of " + f.name, ["s", "event", "detail"], [...f.events].sort((a, b) => a[0] - b[0]).map(([t, n, d]) => [t.toFixed(1), n, d]), [0])));
main.append(el("h2", {}, "Not in the record"));
row(...flights.map((f) => el("ul", { class: "missing" }, ...f.missing.map((m) => el("li", {}, m)))));

for (const [host, panel] of hosts) plotIn(host, panel);
zoomAll(...whole);
drawPaths();
document.getElementById("reset").addEventListener("click", () => zoomAll(...whole));
const redraw = () => { for (const plot of plots) plot.redraw(false); drawPaths(); };
document.getElementById("theme").addEventListener("click", () => { root.classList.toggle("dark"); redraw(); });
const resize = () => { for (const plot of plots) plot.setSize({ width: plot.host.clientWidth, height: plot.height }); drawPaths(); };
let wait = 0;
addEventListener("resize", () => { clearTimeout(wait); wait = setTimeout(resize, 100); });
addEventListener("beforeprint", () => { root.classList.remove("dark"); redraw(); });
document.body.dataset.ready = "yes";
