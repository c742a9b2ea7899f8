// The page of a run: the picture in space, and charts on the same axis of time.
// What it shows lies in the page: `head` (JSON) describes it, `blob` holds its arrays, `plotly` draws.
"use strict";

const at = (id) => document.getElementById(id);
const NAN3 = [NaN, NaN, NaN];
const ROBOTS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"]; // Okabe and Ito (2008)
const CURVES = [...ROBOTS, "#8a8a8a"];
const DASHES = ["solid", "dash", "dot", "dashdot", "longdash", "longdashdot"]; // along the second axis of a signal
const RODS = [["#5a6b7b", "#b8c6d4"], ["#c2410c", "#fdba74"]]; // of either run, in light and in dark
const CAMERAS = {
  oblique: { eye: { x: -0.95, y: -1.7, z: 1.05 }, up: { x: 0, y: 0, z: 1 } },
  front: { eye: { x: 0, y: -2.2, z: 0.01 }, up: { x: 0, y: 0, z: 1 } },
  side: { eye: { x: 2.2, y: 0, z: 0.01 }, up: { x: 0, y: 0, z: 1 } },
  top: { eye: { x: 0, y: 0, z: 2.2 }, up: { x: 0, y: 1, z: 0 } },
};
for (const camera of Object.values(CAMERAS)) camera.center = { x: 0, y: 0, z: 0 };
const CONFIG = { responsive: true, displaylogo: false, plotlyServerURL: "", modeBarButtonsToRemove: ["sendChartToCloud"] }; // nothing leaves the page
const LONGEST = 2.5; // of the arrows [m]
const SIDE = 1.7; // longest of the box of axes, in the unit of cameras
const MARGIN = 1.2; // around all that is seen [m]
const NEAR = 8, CLOSE = 1.4; // half of what is seen when the camera follows the truss, a robot [m]

// ---- what lies in the page -----------------------------------------------------------------------------

async function inflated(id) {
  const text = atob(at(id).textContent), bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Bytes lie sorted by their place in the number (they compress better), numbers by component.
function unpacked(blob, { offset, shape, width }) {
  const count = shape.reduce((a, b) => a * b, 1);
  const bytes = new Uint8Array(count * width);
  for (let k = 0; k < width; k++)
    for (let i = 0; i < count; i++) bytes[i * width + k] = blob[offset + k * count + i];
  const all = width === 8 ? new Float64Array(bytes.buffer) : new Float32Array(bytes.buffer);
  return Array.from({ length: shape[0] }, (_, i) => all.subarray((i * count) / shape[0], ((i + 1) * count) / shape[0]));
}

const replaced = (value, blob) => {
  if (value === null || typeof value !== "object") return value;
  if ("width" in value && "offset" in value) return unpacked(blob, value);
  if (Array.isArray(value)) return value.map((v) => replaced(v, blob));
  return Object.fromEntries(Object.entries(value).map(([k, v]) => [k, replaced(v, blob)]));
};

// ---- kinematics: matrices are lists of nine numbers, row by row; the equations are those of models/ -----

const times = (A, B) => [0, 3, 6].flatMap((i) => [0, 1, 2].map((j) => A[i] * B[j] + A[i + 1] * B[j + 3] + A[i + 2] * B[j + 6]));
const turned = (A, v) => [0, 3, 6].map((i) => A[i] * v[0] + A[i + 1] * v[1] + A[i + 2] * v[2]);
const sum = (a, b, scale = 1) => [a[0] + scale * b[0], a[1] + scale * b[1], a[2] + scale * b[2]];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const length = (a) => Math.hypot(...a);

function aboutZ(angle) {
  const c = Math.cos(angle), s = Math.sin(angle);
  return [c, -s, 0, s, c, 0, 0, 0, 1];
}

function attitude([phi, theta, psi]) { // R_z(psi) R_x(phi) R_y(theta)
  const c = Math.cos(phi), s = Math.sin(phi), C = Math.cos(theta), S = Math.sin(theta);
  return times(aboutZ(psi), times([1, 0, 0, 0, c, -s, 0, s, c], [C, 0, S, 0, 1, 0, -S, 0, C]));
}

function cayley([x, y, z]) {
  const q = (x * x + y * y + z * z) / 4, a = 1 - q, b = 1 + q;
  return [a + (x * x) / 2, (x * y) / 2 - z, (x * z) / 2 + y, (x * y) / 2 + z, a + (y * y) / 2, (y * z) / 2 - x,
    (x * z) / 2 - y, (y * z) / 2 + x, a + (z * z) / 2].map((element) => element / b);
}

// Displacement by the modes of point i of `shapes`: one list per point, its x, y and z for each mode in turn.
function modal(shape, modes, scale) {
  const h = modes.length, found = [0, 0, 0];
  for (let axis = 0; axis < 3; axis++)
    for (let k = 0; k < h; k++) found[axis] += shape[axis * h + k] * modes[k] * scale;
  return found;
}

// Where everything is: root [m], three angles, all joint angles [rad], modal coordinates times `scale`.
function posed(truss, root, joints, modes, scale) {
  const R = attitude(root.slice(3)), place = (v) => sum(root, turned(R, v));
  const points = truss.points.map((r, i) => place(sum(r, modal(truss.shapes[i], modes, scale))));
  let next = 0;
  const arms = truss.arms.map((arm) => {
    let p = sum(arm.grasp, modal(arm.translation, modes, scale));
    let A = times(cayley(modal(arm.rotation, modes, scale)), arm.hand);
    const chain = [p];
    arm.origins.forEach((origin, j) => {
      p = sum(p, turned(A, origin));
      A = times(times(A, arm.rotations[j]), aboutZ(joints[next++]));
      chain.push(p);
    });
    const centre = sum(p, turned(A, arm.basePosition));
    const axes = times(A, arm.baseRotation);
    const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((k) =>
      place(sum(centre, turned(axes, arm.box.map((half, axis) => ((k >> axis) & 1 ? half : -half))))));
    return { chain: chain.map(place), centre: place(centre), axes: times(R, axes), corners };
  });
  return { root: root.slice(0, 3), points, arms };
}

// The last instant logged that is not after t.
function index(time, t) {
  let low = 0, high = time.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (time[middle] <= t + 1e-9) low = middle;
    else high = middle - 1;
  }
  return low;
}

const row = (columns, i) => Array.from(columns, (column) => column[i]);

function poseOf(run, t, scale) {
  const i = index(run.time[0], t);
  return { i, ...posed(run.truss, row(run.root, i), row(run.joints, i), row(run.modes, i), scale) };
}

// ---- the picture ------------------------------------------------------------------------------------------

const columns = (points) => ({ x: points.map((p) => p[0]), y: points.map((p) => p[1]), z: points.map((p) => p[2]) });
const rods = (truss, pose) => truss.rods.flatMap(([a, b]) => [pose.points[a], pose.points[b], NAN3]);

// An arrow of lines: its shaft and one head of four strokes for a force, two heads for a torque.
function arrow(from, along, heads) {
  const size = length(along), strokes = [];
  if (!(size > 1e-3 * LONGEST)) return Array(3 + 12 * heads).fill(NAN3);
  const unit = along.map((a) => a / size), tip = sum(from, along), head = Math.min(size / 3, 0.4);
  const aside = cross(unit, Math.abs(unit[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]).map((a, _, all) => a / length(all));
  const up = cross(unit, aside);
  for (let k = 0; k < heads; k++) {
    const top = sum(tip, unit, -0.7 * k * head), neck = sum(top, unit, -head);
    for (const [direction, sign] of [[aside, 1], [aside, -1], [up, 1], [up, -1]])
      strokes.push(top, sum(neck, direction, sign * 0.4 * head), NAN3);
  }
  return [from, tip, NAN3, ...strokes];
}

const arrows = (run, pose, name, heads, longest) => pose.arms.flatMap((arm, k) => {
  const [x, y, z] = row(run[name].slice(3 * k, 3 * k + 3), pose.i);
  return arrow(arm.centre, turned(arm.axes, [x, y, z]).map((a) => (a * LONGEST) / longest), heads);
});

// Twelve triangles of a box whose corner k has the bits of k as signs.
const BOX = [[0, 1, 3], [0, 3, 2], [4, 7, 5], [4, 6, 7], [0, 5, 1], [0, 4, 5], [2, 3, 7], [2, 7, 6], [0, 2, 6],
  [0, 6, 4], [1, 5, 7], [1, 7, 3]];
const [I, J, K] = [0, 1, 2].map((k) => BOX.map((triangle) => triangle[k]));

// What is drawn of a run: how each part looks, and where its points are in a pose; `fixed` ones never move.
function partsOf(run, number, page) {
  const who = page.runs.length > 1 ? `, ${run.name}` : "", colour = RODS[number][page.dark ? 1 : 0];
  const line = (name, width, color, points, more = {}, fixed = false) => ({ // one entry in the legend for both runs
    look: { type: "scatter3d", mode: "lines", name, hoverinfo: "name", legendgroup: name, showlegend: !number, line: { width, color }, ...more }, points, fixed, number,
  });
  const path = Array.from(run.time[0], (_, i) => row(run.root.slice(0, 3), i));
  const parts = [line(`truss${who}`, 5, colour, (pose) => rods(run.truss, pose), { showlegend: true }), line("path of the root", 3, colour, () => path, { opacity: 0.5 }, true)];
  run.truss.arms.forEach((_, k) => {
    const color = ROBOTS[k % ROBOTS.length], legendgroup = `robot ${k + 1}`, opacity = number ? 0.3 : 0.6; // the arms lie folded on the bases
    const marker = { size: 3.5, color };
    parts.push(line(legendgroup, 8, color, (pose) => [...pose.arms[k].chain, pose.arms[k].centre], { mode: "lines+markers", marker }));
    parts.push({ look: { type: "mesh3d", flatshading: true, hoverinfo: "skip", color, opacity, legendgroup, i: I, j: J, k: K }, points: (pose) => pose.arms[k].corners, number });
  });
  for (const [name, what, unit, heads, color] of ARROWS)
    if (run[name].length > 0)
      parts.push(line(`${what}, at most ${page.longest[name].toPrecision(2)} ${unit}`, 6, color, (pose) => arrows(run, pose, name, heads, page.longest[name])));
  return parts;
}

const ARROWS = [["force", "thrust", "N", 1, "#dc2626"], ["torque", "torque", "N·m", 2, "#a855f7"]];

// Sides of the box that plotly draws in, so that a metre is as long along every axis.
function aspect(ranges) {
  const sides = ranges.map(([low, high]) => high - low), unit = Math.max(...sides) / SIDE;
  return { x: sides[0] / unit, y: sides[1] / unit, z: sides[2] / unit };
}

// ---- the page ---------------------------------------------------------------------------------------------

class Page {
  constructor(head) {
    Object.assign(this, head, { playing: false, charts: [] });
    this.start = Math.min(...this.runs.map((run) => run.time[0][0]));
    this.end = Math.max(...this.runs.map((run) => run.time[0].at(-1)));
    this.range = [this.start, this.end];
    this.t = this.start;
    this.theme = matchMedia("(prefers-color-scheme: dark)");
    this.longest = Object.fromEntries(ARROWS.map(([name]) => [name, this.peak(name)]));
    this.bounds = this.extent();
  }

  get dark() { return this.theme.matches; }
  get scale() { return Number(at("exaggeration").value); }
  get colours() { return this.dark ? { text: "#e5e7eb", grid: "#374151" } : { text: "#1f2937", grid: "#d5dae1" }; }

  peak(name) { // longest vector of three of all robots, instants and runs
    let square = 0;
    for (const run of this.runs)
      for (let k = 0; k < run[name].length; k += 3)
        for (let i = 0; i < run[name][k].length; i++)
          square = Math.max(square, run[name][k][i] ** 2 + run[name][k + 1][i] ** 2 + run[name][k + 2][i] ** 2);
    return Math.sqrt(square) || 1;
  }

  extent() { // of all runs, at some instants
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    const poses = this.runs.flatMap((run) => Array.from({ length: 21 }, (_, k) => poseOf(run, this.start + ((this.end - this.start) * k) / 20, 1)));
    if (this.target) poses.push(this.goal());
    for (const pose of poses)
      for (const point of [...pose.points, ...pose.arms.flatMap((arm) => arm.corners)])
        for (let axis = 0; axis < 3; axis++) {
          low[axis] = Math.min(low[axis], point[axis] - MARGIN);
          high[axis] = Math.max(high[axis], point[axis] + MARGIN);
        }
    return low.map((value, axis) => [value, high[axis]]);
  }

  goal() {
    const { truss } = this.runs[0];
    return posed(truss, this.target.slice(0, 6), this.target.slice(6), [], 1);
  }

  axes() { // limits of x, y and z
    const followed = at("follow").value;
    if (followed === "nothing") return this.bounds;
    const [pose] = this.poses, points = followed === "truss" ? pose.points : pose.arms[Number(followed)].chain;
    const half = followed === "truss" ? NEAR : CLOSE;
    return points.reduce((a, b) => sum(a, b), [0, 0, 0]).map((a) => [a / points.length - half, a / points.length + half]);
  }

  layout() {
    const { text, grid } = this.colours, ranges = this.axes();
    const axis = (name, k) => ({ title: { text: `${name} [m]` }, range: ranges[k], color: text, gridcolor: grid, zerolinecolor: grid, showbackground: false, showspikes: false, nticks: 6 });
    return {
      paper_bgcolor: "rgba(0,0,0,0)", font: { color: text, size: 12 }, margin: { l: 0, r: 0, t: 0, b: 0 }, uirevision: "kept",
      legend: { x: 0, y: 1, tracegroupgap: 0, bgcolor: "rgba(0,0,0,0)" },
      scene: { bgcolor: "rgba(0,0,0,0)", aspectmode: "manual", aspectratio: aspect(ranges), xaxis: axis("x", 0), yaxis: axis("y", 1), zaxis: axis("z", 2), camera: CAMERAS[this.camera] || CAMERAS.oblique },
    };
  }

  pose() { this.poses = this.runs.map((run) => poseOf(run, this.t, this.scale)); }

  async draw() {
    this.pose();
    this.parts = this.runs.flatMap((run, number) => partsOf(run, number, this));
    if (this.target) {
      const { truss } = this.runs[0], goal = this.goal(), points = [...rods(truss, goal), ...goal.arms.flatMap((arm) => [...arm.chain, arm.centre, NAN3])];
      const look = { type: "scatter3d", mode: "lines", name: "target", hoverinfo: "name", opacity: 0.5, line: { width: 3, color: "#16a34a" } };
      this.parts.push({ look, points: () => points, fixed: true, number: 0 });
    }
    const all = this.parts.map(({ look, points, number }) => ({ ...look, ...columns(points(this.poses[number])) }));
    await Plotly.react(at("picture"), all, this.layout(), { ...CONFIG, displayModeBar: document.body.className ? false : "hover" });
  }

  async show(t) {
    this.t = Math.min(this.end, Math.max(this.start, t));
    at("time").value = this.t;
    at("now").textContent = `${this.t.toFixed(2)} s`;
    at("scale").textContent = `deformation × ${this.scale}`;
    this.pose();
    const places = this.parts.flatMap(({ fixed }, k) => (fixed ? [] : [k]));
    const moved = places.map((k) => columns(this.parts[k].points(this.poses[this.parts[k].number])));
    const [x, y, z] = ["x", "y", "z"].map((axis) => moved.map((part) => part[axis]));
    await Plotly.update(at("picture"), { x, y, z }, at("follow").value === "nothing" ? {} : this.ranges(), places);
    for (const chart of this.charts) chart.mark();
  }

  ranges() {
    const ranges = this.axes(), found = Object.fromEntries(ranges.map((range, k) => [`scene.${"xyz"[k]}axis.range`, range]));
    return { ...found, "scene.aspectratio": aspect(ranges) };
  }

  look(camera) { return Plotly.relayout(at("picture"), { "scene.camera": CAMERAS[camera] }); }

  step(count) {
    const time = this.runs[0].time[0], i = index(time, this.t) + count;
    return this.show(time[Math.min(time.length - 1, Math.max(0, i))]);
  }

  play(on = !this.playing) {
    this.playing = on;
    at("play").textContent = on ? "❚❚ pause" : "▶ play";
    if (!on) return;
    if (this.t >= this.end) this.t = this.start;
    let last = performance.now();
    const tick = async (now) => {
      if (!this.playing) return;
      const elapsed = Math.max(0, now - last) / 1000;
      last = Math.max(now, last);
      await this.show(this.t + elapsed * Number(at("speed").value));
      if (this.t >= this.end) this.play(false);
      else requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }
}

// ---- charts -----------------------------------------------------------------------------------------------

const SPACE = { l: 62, r: 112, t: 6, b: 34 }; // around a chart, the same for all: their axes of time are aligned [px]

class Chart {
  constructor(place, name, page) {
    this.place = place;
    this.cursor = element("div", "cursor", place.parentNode);
    this.page = page;
    this.drawn = this.draw(name);
  }

  async draw(name = this.name) {
    this.name = name;
    const { text, grid } = this.page.colours, data = [];
    let units = "", legend = true;
    this.page.runs.forEach((run, number) => {
      const signal = run.signals.find((one) => one.name === name);
      if (!signal) return;
      units = signal.units;
      signal.values.forEach((y, k) => data.push({
        type: "scatter", mode: "lines", x: run.signalTime[0], y, name: signal.components[k], legendgroup: signal.components[k], showlegend: legend && signal.values.length > 1,
        opacity: number ? 0.5 : 1, hovertemplate: `%{y:.4g}<extra>${signal.components[k]} ${this.page.runs.length > 1 ? run.name : ""}</extra>`,
        line: { width: 1.3, color: CURVES[Math.floor(k / signal.inner) % CURVES.length], dash: signal.inner > 1 ? DASHES[k % signal.inner % DASHES.length] : "solid" },
      }));
      legend = false;
    });
    const axis = { color: text, gridcolor: grid, zerolinecolor: grid, linecolor: grid };
    const layout = {
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: { color: text, size: 11 }, margin: { ...SPACE, autoexpand: false }, hovermode: "x", hoverdistance: -1, dragmode: "zoom",
      legend: { x: 1.01, y: 1, font: { size: 10 }, bgcolor: "rgba(0,0,0,0)" },
      xaxis: { ...axis, title: { text: "time [s]", standoff: 4 }, range: this.page.range.slice() }, yaxis: { ...axis, title: { text: units && `[${units}]` }, exponentformat: "e" },
    };
    await Plotly.react(this.place, data, layout, { ...CONFIG, displayModeBar: false });
    this.place.removeAllListeners("plotly_click");
    this.place.on("plotly_click", ({ points }) => this.page.show(points[0].x));
    this.place.removeAllListeners("plotly_relayout");
    this.place.on("plotly_relayout", (change) => this.zoomed(change));
  }

  mark() { // a line of its own: plotly would draw the whole chart anew
    const [low, high] = this.page.range, part = (this.page.t - low) / (high - low);
    this.cursor.hidden = part < 0 || part > 1;
    this.cursor.style.left = `calc(${SPACE.l}px + ${part} * (100% - ${SPACE.l + SPACE.r}px))`;
  }

  zoomed(change) { // all charts have one axis of time
    let range = [change["xaxis.range[0]"], change["xaxis.range[1]"]];
    if (change["xaxis.autorange"]) range = [this.page.start, this.page.end];
    if (range[0] === undefined) return;
    this.page.range = range;
    for (const chart of this.page.charts) {
      Plotly.relayout(chart.place, { "xaxis.range": range.slice() });
      chart.mark();
    }
  }
}

function option(value, text = value) {
  const found = document.createElement("option");
  found.value = value;
  found.textContent = text;
  return found;
}

function element(kind, className, parent) {
  const found = document.createElement(kind);
  found.className = className;
  parent.append(found);
  return found;
}

async function begin() {
  document.head.append(Object.assign(document.createElement("script"), { textContent: new TextDecoder().decode(await inflated("plotly")) }));
  const head = replaced(JSON.parse(at("head").textContent), await inflated("blob"));
  const asked = new URLSearchParams(location.hash.slice(1));
  if (asked.has("still")) { // a picture of so many pixels height, and nothing else
    document.body.className = "still";
    at("picture").style.height = `${asked.get("still")}px`;
  }
  at("exaggeration").value = asked.get("exaggeration") ?? head.exaggeration;
  head.camera = asked.get("camera");
  const page = new Page(head);
  at("time").min = page.start;
  at("time").max = page.end;
  if (page.runs.length > 1) at("second").textContent = `faint curves: ${page.runs[1].name}`;
  Object.keys(CAMERAS).forEach((name) => at("camera").append(option(name)));
  if (CAMERAS[head.camera]) at("camera").value = head.camera;
  at("follow").append(option("nothing"), option("truss"), ...head.runs[0].truss.arms.map((_, k) => option(k, `robot ${k + 1}`)));
  at("follow").value = asked.get("follow") ?? "nothing";
  await page.draw();
  if (!asked.has("still")) {
    const names = [...new Map(page.runs.flatMap((run) => run.signals.map((signal) => [signal.name, signal.label])))];
    for (const name of head.shown) {
      const box = element("div", "chart", at("charts")), choice = element("select", "", box);
      choice.setAttribute("aria-label", "signal");
      names.forEach(([value, text]) => choice.append(option(value, text)));
      choice.value = name;
      const chart = new Chart(element("div", "plot", box), name, page);
      page.charts.push(chart);
      choice.addEventListener("change", () => chart.draw(choice.value));
    }
    for (const place of document.querySelectorAll("[data-signal]")) page.charts.push(new Chart(place, place.dataset.signal, page));
  }
  await Promise.all(page.charts.map((chart) => chart.drawn));
  at("play").addEventListener("click", () => page.play());
  at("back").addEventListener("click", () => page.step(-1));
  at("forth").addEventListener("click", () => page.step(1));
  at("time").addEventListener("input", () => page.show(Number(at("time").value)));
  at("exaggeration").addEventListener("input", () => page.show(page.t));
  at("camera").addEventListener("change", () => page.look(at("camera").value));
  at("follow").addEventListener("change", () => Plotly.relayout(at("picture"), page.ranges()));
  page.theme.addEventListener("change", () => Promise.all([page.draw(), ...page.charts.map((chart) => chart.draw())]));
  await page.show(Number(asked.get("t") ?? page.start));
  window.page = page;
  document.body.dataset.state = "ready";
}

begin().catch((error) => {
  at("trouble").textContent = `This page cannot be shown: ${error.message}`;
  throw error;
});
