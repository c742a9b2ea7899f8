// The page of a run: the picture in space, and charts on the same axis of time.
// What it shows lies in the page: `head` (JSON) describes it, `blob` holds its arrays, `plotly` draws.
"use strict";

const at = (id) => document.getElementById(id);
const NAN3 = [NaN, NaN, NaN];
// Okabe and Ito (2008), and two that are seen in light and in dark: of robots, in space and in charts.
const COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8a8a8a", "#a16207"];
const DASHES = ["solid", "dash", "dot", "dashdot", "longdash", "longdashdot"]; // second axis of a signal
const RODS = [["#5a6b7b", "#b8c6d4"], ["#c2410c", "#fdba74"]]; // of either run, in light and in dark
const CAMERAS = {
  oblique: { eye: { x: -0.95, y: -1.7, z: 1.05 }, up: { x: 0, y: 0, z: 1 } },
  front: { eye: { x: 0, y: -2.2, z: 0.01 }, up: { x: 0, y: 0, z: 1 } },
  side: { eye: { x: 2.2, y: 0, z: 0.01 }, up: { x: 0, y: 0, z: 1 } },
  top: { eye: { x: 0, y: 0, z: 2.2 }, up: { x: 0, y: 1, z: 0 } },
};
for (const camera of Object.values(CAMERAS)) camera.center = { x: 0, y: 0, z: 0 };
CAMERAS.oblique.center.z = -0.12; // so that the names of all axes are in the picture
const LIGHT = { text: "#1f2937", grid: "#d5dae1" }, DARK = { text: "#e5e7eb", grid: "#374151" };
const CLEAR = "rgba(0,0,0,0)";
// Nothing leaves the page.
const CONFIG = {
  responsive: true, displaylogo: false, plotlyServerURL: "", modeBarButtonsToRemove: ["sendChartToCloud"],
};
const LONGEST = 2.5; // of the arrows [m]
const SIDE = 1.55; // longest of the box of axes, in the unit of cameras
const MARGIN = 1.2; // around all that is seen [m]
const NEAR = 8, CLOSE = 2; // half of what is seen at least when the camera follows the truss, a robot [m]
const FAR = 30; // times as much as the truss needs is too much: it would be a dot [-]
const LOST = 1e5; // what is farther away is no longer drawn: beside it all else would vanish [m]

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
  const each = count / shape[0];
  return Array.from({ length: shape[0] }, (_, i) => all.subarray(i * each, (i + 1) * each));
}

const replaced = (value, blob) => {
  if (value === null || typeof value !== "object") return value;
  if ("width" in value && "offset" in value) return unpacked(blob, value);
  if (Array.isArray(value)) return value.map((v) => replaced(v, blob));
  return Object.fromEntries(Object.entries(value).map(([k, v]) => [k, replaced(v, blob)]));
};

// ---- kinematics: matrices are lists of nine numbers, row by row; the equations are those of models/ -----

const times = (A, B) =>
  [0, 3, 6].flatMap((i) => [0, 1, 2].map((j) => A[i] * B[j] + A[i + 1] * B[j + 3] + A[i + 2] * B[j + 6]));
const turned = (A, v) => [0, 3, 6].map((i) => A[i] * v[0] + A[i + 1] * v[1] + A[i + 2] * v[2]);
const sum = (a, b, scale = 1) => [a[0] + scale * b[0], a[1] + scale * b[1], a[2] + scale * b[2]];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const length = (a) => Math.hypot(...a);

function aboutZ(angle) {
  const c = Math.cos(angle), s = Math.sin(angle);
  return [c, -s, 0, s, c, 0, 0, 0, 1];
}

function attitude(numbers) { // a quaternion, scalar first, or R_z(psi) R_x(phi) R_y(theta)
  if (numbers.length === 4) return quaternion(numbers);
  const [phi, theta, psi] = numbers;
  const c = Math.cos(phi), s = Math.sin(phi), C = Math.cos(theta), S = Math.sin(theta);
  return times(aboutZ(psi), times([1, 0, 0, 0, c, -s, 0, s, c], [C, 0, S, 0, 1, 0, -S, 0, C]));
}

function quaternion([w, x, y, z]) {
  const s = 2 / (w * w + x * x + y * y + z * z);
  return [
    1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y),
    s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x),
    s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y),
  ];
}

function cayley([x, y, z]) {
  const q = (x * x + y * y + z * z) / 4, a = 1 - q, b = 1 + q;
  return [
    a + (x * x) / 2, (x * y) / 2 - z, (x * z) / 2 + y,
    (x * y) / 2 + z, a + (y * y) / 2, (y * z) / 2 - x,
    (x * z) / 2 - y, (y * z) / 2 + x, a + (z * z) / 2,
  ].map((value) => value / b);
}

// Displacement by the modes of point i of `shapes`: one list per point, its x, y and z for each mode in turn.
function modal(shape, modes, scale) {
  const h = modes.length, found = [0, 0, 0];
  for (let axis = 0; axis < 3; axis++)
    for (let k = 0; k < h; k++) found[axis] += shape[axis * h + k] * modes[k] * scale;
  return found;
}

// Where everything is: root [m] and its attitude, all joints [rad or m], modal coordinates times `scale`.
function posed(truss, root, joints, modes, scale) {
  const R = attitude(root.slice(3)), place = (v) => sum(root, turned(R, v));
  const points = truss.points.map((r, i) => place(sum(r, modal(truss.shapes[i], modes, scale))));
  let next = 0;
  const arms = truss.arms.map((arm) => {
    let p = sum(arm.grasp, modal(arm.translation, modes, scale));
    let A = times(cayley(modal(arm.rotation, modes, scale)), arm.hand);
    const chain = [p], bodies = [[p, A]];
    arm.origins.forEach((origin, j) => {
      p = sum(p, turned(A, origin));
      A = times(A, arm.rotations[j]);
      const moved = joints[next++];
      if (arm.sliding[j]) p = sum(p, turned(A, [0, 0, moved]));
      else A = times(A, aboutZ(moved));
      chain.push(p);
      bodies.push([p, A]);
    });
    const centre = sum(p, turned(A, arm.basePosition));
    const axes = times(A, arm.baseRotation);
    const placed = bodies.map(([at, turn]) => [place(at), times(R, turn)]);
    const corners = arm.solid.points.map((point, k) => {
      const [at, turn] = placed[arm.solid.bodies[k]];
      return sum(at, turned(turn, point));
    });
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

const columns = (points) => {
  const near = (a) => (Math.abs(a) < LOST ? a : NaN);
  const [x, y, z] = [0, 1, 2].map((axis) => points.map((point) => near(point[axis])));
  return { x, y, z };
};
const rods = (truss, pose) => truss.rods.flatMap(([a, b]) => [pose.points[a], pose.points[b], NAN3]);

// An arrow of lines: its shaft and one head of four strokes for a force, two heads for a torque.
function arrow(from, along, heads) {
  const size = length(along), strokes = [];
  if (!(size > 1e-3 * LONGEST)) return Array(3 + 12 * heads).fill(NAN3);
  const unit = along.map((a) => a / size), tip = sum(from, along), head = Math.min(size / 3, 0.4);
  const across = cross(unit, Math.abs(unit[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]);
  const aside = across.map((a) => a / length(across)), up = cross(unit, aside);
  for (let k = 0; k < heads; k++) {
    const top = sum(tip, unit, -0.7 * k * head), neck = sum(top, unit, -head);
    for (const [direction, sign] of [[aside, 1], [aside, -1], [up, 1], [up, -1]])
      strokes.push(top, sum(neck, direction, sign * 0.4 * head), NAN3);
  }
  return [from, tip, NAN3, ...strokes];
}

const arrows = (run, pose, name, heads, longest) => pose.arms.flatMap((arm, k) => {
  const vector = row(run[name].slice(3 * k, 3 * k + 3), pose.i).map((a) => (a * LONGEST) / longest);
  return arrow(arm.centre, turned(arm.axes, vector), heads);
});

// What is drawn of a run: how each part looks, and where its points are in a pose; `fixed` ones never move.
function partsOf(run, number, page) {
  const parts = [], who = page.runs.length > 1 ? `, ${run.name}` : "", colour = RODS[number][+page.dark];
  const part = (look, points, fixed = false) => parts.push({ look, points, fixed, number });
  const line = (name, width, color, more = {}) => ({ // in the legend once for both runs, but for the truss
    type: "scatter3d", mode: "lines", name, legendgroup: name, showlegend: !number, hoverinfo: "name",
    line: { width, color }, ...more,
  });
  const path = Array.from(run.time[0], (_, i) => row(run.root.slice(0, 3), i));
  part(line(`truss${who}`, 5, colour, { showlegend: true }), (pose) => rods(run.truss, pose));
  part(line("path of the root", 3, colour, { opacity: 0.5 }), () => path, true);
  run.truss.arms.forEach(({ solid }, k) => {
    const name = `robot ${k + 1}`, color = COLOURS[k % COLOURS.length];
    const marker = { size: solid.drawn ? 1 : 3.5, color }, [I, J, K] = solid.faces;
    const arm = (pose) => [...pose.arms[k].chain, pose.arms[k].centre];
    part(line(name, solid.drawn ? 2 : 8, color, { mode: "lines+markers", marker }), arm);
    const opacity = number ? 0.3 : solid.drawn ? 1 : 0.6; // for the arms, which lie folded on the boxes
    const mesh = { type: "mesh3d", legendgroup: name, hoverinfo: "skip", flatshading: true, i: I, j: J, k: K };
    // Its triangles are small, which plotly takes for none that could be lit, unless it is told.
    if (solid.drawn) mesh.lighting = { ambient: 0.6, diffuse: 0.6, specular: 0.1, facenormalsepsilon: 1e-15 };
    part({ ...mesh, color, opacity }, (pose) => pose.arms[k].corners);
  });
  for (const [name, what, unit, heads, color] of ARROWS) {
    const longest = page.longest[name], title = `${what}, at most ${longest.toPrecision(2)} ${unit}`;
    if (run[name].length && longest) part(line(title, 6, color), (pose) => arrows(run, pose, name, heads, longest));
  }
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
  constructor(head, camera) {
    Object.assign(this, head, { camera, playing: false, charts: [] });
    this.start = Math.min(...this.runs.map((run) => run.time[0][0]));
    this.end = Math.max(...this.runs.map((run) => run.time[0].at(-1)));
    this.range = [this.start, this.end]; // of the charts
    this.t = this.start;
    this.theme = matchMedia("(prefers-color-scheme: dark)");
    this.longest = Object.fromEntries(ARROWS.map(([name]) => [name, this.peak(name)]));
    this.bounds = this.extent();
    const spans = [0, 1, 2].map((k) => this.runs[0].truss.points.map((point) => point[k]));
    this.near = Math.max(NEAR, ...spans.map((at) => (Math.max(...at) - Math.min(...at)) / 2 + MARGIN));
  }

  get far() { return this.lost || this.bounds.some(([low, high]) => !(high - low < FAR * 2 * this.near)); }

  get dark() { return this.theme.matches; }
  get scale() { return Number(at("exaggeration").value); }
  get colours() { return this.dark ? DARK : LIGHT; }

  peak(name) { // longest vector of three of all robots, instants and runs
    let longest = 0;
    for (const run of this.runs)
      for (let k = 0; k < run[name].length; k += 3) {
        const vectors = run[name].slice(k, k + 3);
        vectors[0].forEach((_, i) => { longest = Math.max(longest, length(row(vectors, i))); });
      }
    return longest;
  }

  extent() { // of all runs, at some instants
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    const instants = Array.from({ length: 21 }, (_, k) => this.start + ((this.end - this.start) * k) / 20);
    const poses = this.runs.flatMap((run) => instants.map((t) => poseOf(run, t, 1)));
    if (this.target) poses.push(this.goal());
    for (const pose of poses)
      for (const point of [...pose.points, ...pose.arms.flatMap((arm) => arm.corners)])
        for (let axis = 0; axis < 3; axis++) {
          const seen = Math.abs(point[axis]) < LOST;
          this.lost ||= !seen;
          if (!seen) continue;
          low[axis] = Math.min(low[axis], point[axis] - MARGIN);
          high[axis] = Math.max(high[axis], point[axis] + MARGIN);
        }
    return low.map((value, axis) => [value, high[axis]]);
  }

  goal() {
    const { truss, root } = this.runs[0], count = root.length;
    return posed(truss, this.target.slice(0, count), this.target.slice(count), [], 1);
  }

  axes() { // limits of x, y and z
    const followed = at("follow").value;
    if (followed === "nothing") return this.bounds;
    const { points, arms } = this.poses[0], whole = followed === "truss";
    const seen = whole ? points : arms[Number(followed)].chain, half = whole ? this.near : CLOSE;
    const middle = seen.reduce((a, b) => sum(a, b)).map((a) => a / seen.length);
    if (middle.every((a) => Math.abs(a) < LOST)) this.seen = middle.map((a) => [a - half, a + half]);
    return this.seen ?? this.bounds;
  }

  ranges() {
    const ranges = this.axes(), changed = { "scene.aspectratio": aspect(ranges) };
    ranges.forEach((range, k) => { changed[`scene.${"xyz"[k]}axis.range`] = range; });
    return changed;
  }

  layout() {
    const { text, grid } = this.colours, ranges = this.axes();
    const [xaxis, yaxis, zaxis] = ranges.map((range, k) => ({
      range, title: { text: `${"xyz"[k]} [m]` }, color: text, gridcolor: grid, zerolinecolor: grid,
      showbackground: false, showspikes: false, nticks: 6,
    }));
    return {
      paper_bgcolor: CLEAR, font: { color: text, size: 12 }, margin: { l: 0, r: 0, t: 0, b: 0 },
      showlegend: at("picture").clientWidth > 500, legend: { x: 0, y: 1, tracegroupgap: 0, bgcolor: CLEAR },
      uirevision: "kept", // the camera that the reader turned
      scene: {
        xaxis, yaxis, zaxis, aspectmode: "manual", aspectratio: aspect(ranges), bgcolor: CLEAR,
        camera: CAMERAS[this.camera],
      },
    };
  }

  pose() { this.poses = this.runs.map((run) => poseOf(run, this.t, this.scale)); }

  async draw() {
    this.pose();
    this.parts = this.runs.flatMap((run, number) => partsOf(run, number, this));
    if (this.target) {
      const { truss } = this.runs[0], goal = this.goal();
      const line = { width: 3, color: this.dark ? "#4ade80" : "#16a34a" };
      const ghost = { hoverinfo: "skip", opacity: 0.5, line };
      const points = [...rods(truss, goal), ...goal.arms.flatMap((arm) => [...arm.chain, arm.centre, NAN3])];
      const look = { type: "scatter3d", mode: "lines", name: "target", ...ghost };
      this.parts.push({ look, points: () => points, fixed: true, number: 0 });
    }
    const placed = ({ look, points, number }) => ({ ...look, ...columns(points(this.poses[number])) });
    const displayModeBar = document.body.className === "still" ? false : "hover";
    await Plotly.react(at("picture"), this.parts.map(placed), this.layout(), { ...CONFIG, displayModeBar });
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
    const limits = at("follow").value === "nothing" ? {} : this.ranges();
    await Plotly.update(at("picture"), { x, y, z }, limits, places);
    for (const chart of this.charts) chart.mark();
  }

  look(camera) {
    this.camera = camera;
    return Plotly.relayout(at("picture"), { "scene.camera": CAMERAS[camera] });
  }

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

const SPACE = { l: 62, r: 112, t: 6, b: 34 }; // around each chart: their axes of time are aligned [px]

class Chart {
  constructor(place, name, page) {
    Object.assign(this, { place, page, name });
    this.cursor = element("div", "cursor", place.parentNode);
    this.drawn = this.draw();
  }

  curves(run, signal, faint, showlegend) {
    const { inner, components, values } = signal, who = this.page.runs.length > 1 ? run.name : "";
    return values.map((y, k) => ({
      type: "scatter", mode: "lines", x: run.signalTime[0], y, opacity: faint ? 0.5 : 1,
      name: components[k], legendgroup: components[k], showlegend: showlegend && values.length > 1,
      hovertemplate: `%{y:.4g}<extra>${components[k]} ${who}</extra>`,
      line: {
        width: 1.3, color: COLOURS[Math.floor(k / inner) % COLOURS.length],
        dash: inner > 1 ? DASHES[(k % inner) % DASHES.length] : "solid",
      },
    }));
  }

  async draw() {
    const { text, grid } = this.page.colours, data = [];
    let units = "";
    this.page.runs.forEach((run, number) => {
      const signal = run.signals.find((one) => one.name === this.name);
      if (!signal) return;
      units = signal.units && `[${signal.units}]`;
      data.push(...this.curves(run, signal, number > 0, data.length === 0));
    });
    const axis = { color: text, gridcolor: grid, zerolinecolor: grid, linecolor: grid };
    const layout = {
      paper_bgcolor: CLEAR, plot_bgcolor: CLEAR, font: { color: text, size: 11 },
      margin: { ...SPACE, autoexpand: false }, hovermode: "x", hoverdistance: -1, dragmode: "zoom",
      legend: { x: 1.01, y: 1, tracegroupgap: 0, font: { size: 10 }, bgcolor: CLEAR },
      xaxis: { ...axis, title: { text: "time [s]", standoff: 4 }, range: this.page.range.slice() },
      yaxis: { ...axis, title: { text: units }, exponentformat: "e" },
    };
    await Plotly.react(this.place, data, layout, { ...CONFIG, displayModeBar: false });
    for (const event of ["plotly_click", "plotly_relayout"]) this.place.removeAllListeners(event);
    this.place.on("plotly_click", ({ points }) => this.page.show(points[0].x));
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

// ---- its controls -----------------------------------------------------------------------------------------

function element(kind, className, parent, more = {}) {
  const found = Object.assign(document.createElement(kind), { className, ...more });
  parent.append(found);
  return found;
}

const choices = (select, named) => {
  for (const [value, textContent] of named) element("option", "", select, { value, textContent });
};

function chartsOf(page) {
  const label = ({ name, units }) => [name, name.replaceAll("_", " ") + (units && ` [${units}]`)];
  const named = new Map(page.runs.flatMap((run) => run.signals.map(label)));
  for (const name of page.shown) {
    const box = element("div", "chart", at("charts"));
    const select = element("select", "", box, { ariaLabel: "signal" });
    choices(select, named);
    select.value = name;
    const chart = new Chart(element("div", "plot", box), name, page);
    select.addEventListener("change", () => { chart.name = select.value; chart.draw(); });
    page.charts.push(chart);
  }
  for (const place of document.querySelectorAll("[data-signal]"))
    page.charts.push(new Chart(place, place.dataset.signal, page));
  return Promise.all(page.charts.map((chart) => chart.drawn));
}

function listen(page) {
  const on = (id, event, action) => at(id).addEventListener(event, action);
  on("play", "click", () => page.play());
  on("back", "click", () => page.step(-1));
  on("forth", "click", () => page.step(1));
  on("time", "input", () => page.show(Number(at("time").value)));
  on("exaggeration", "input", () => page.show(page.t));
  on("camera", "change", () => page.look(at("camera").value));
  on("follow", "change", () => Plotly.relayout(at("picture"), page.ranges()));
  page.theme.addEventListener("change", () => [page, ...page.charts].forEach((drawn) => drawn.draw()));
  document.addEventListener("keydown", (event) => {
    const keys = { " ": () => page.play(), ArrowLeft: () => page.step(-1), ArrowRight: () => page.step(1) };
    if (!keys[event.key] || event.target !== document.body) return;
    event.preventDefault();
    keys[event.key]();
  });
}

async function begin() {
  element("script", "", document.head, { textContent: new TextDecoder().decode(await inflated("plotly")) });
  const head = replaced(JSON.parse(at("head").textContent), await inflated("blob"));
  const asked = new URLSearchParams(location.hash.slice(1)), camera = asked.get("camera") ?? "oblique";
  if (!CAMERAS[camera]) throw new Error(`no camera '${camera}', but ${Object.keys(CAMERAS).join(", ")}`);
  if (asked.has("still")) { // a picture of so many pixels height, and nothing else
    document.body.className = "still";
    at("picture").style.height = `${asked.get("still")}px`;
  }
  choices(at("camera"), Object.keys(CAMERAS).map((name) => [name, name]));
  choices(at("follow"), [["nothing", "nothing"], ["truss", "truss"]]);
  choices(at("follow"), head.runs[0].truss.arms.map((_, k) => [k, `robot ${k + 1}`]));
  at("camera").value = camera;
  at("exaggeration").value = asked.get("exaggeration") ?? head.exaggeration;
  const page = new Page(head, camera), t = Number(asked.get("t") ?? page.start);
  if (!(page.start - 1e-6 <= t && t <= page.end + 1e-6))
    throw new Error(`there is no t = ${asked.get("t")} s, the run is from ${page.start} to ${page.end} s`);
  at("follow").value = asked.get("follow") ?? (page.far ? "truss" : "nothing");
  [at("time").min, at("time").max] = page.range;
  if (page.runs.length > 1) at("second").textContent = `faint curves: ${page.runs[1].name}`;
  await page.draw();
  if (!asked.has("still")) await chartsOf(page);
  listen(page);
  await page.show(t);
  window.page = page;
  document.body.dataset.state = "ready";
  console.info("This page is shown");
}

begin().catch((error) => {
  at("trouble").textContent = `This page cannot be shown: ${error.message}`;
  console.info(at("trouble").textContent);
  throw error;
});
