// The page: sliders ask the worker for runs, and charts, metrics and panels show the latest one.

const data = JSON.parse($("data").textContent, unpacked);
const seconds = data.tick[0] / data.tick[1];
const defaults = data.numbers.slice(0, data.sizes[0]);
const p = defaults.slice();
const live = (window.trussflowLive = { redraws: 0, run: null, data, p });
const end = data.steps * seconds;
let kept = null, asked = 0, planned = false;
const view = { label: "time", unit: "s", ends: [0, end], cursor: null, changed: redraw, pick: point };

/** Return the function of a run that gives a column of its log. */
const column = (index) => (run) => {
  run.columns ??= [];
  return (run.columns[index] ??= Float64Array.from(run.time, (_, i) => run.log[i * data.width + index]));
};
const charts = data.charts.map(({ title, unit, scalar, curves }) => {
  const drawn = curves.map((curve) => ({ ...curve, unit, scalar, values: column(curve.column) }));
  return new Chart($("charts"), { title, unit, curves: drawn }, view);
});
const curves = charts.flatMap((chart) => chart.curves).filter(({ scalar }) => scalar);

// -- the worker

const script = new Blob([$("worker").textContent], { type: "text/javascript" });
const worker = new Worker(URL.createObjectURL(script));

function ask() {
  worker.postMessage({ id: ++asked, p, point: $("point").value });
}

function trouble(text) {
  $("trouble").hidden = !text;
  $("trouble").textContent = text;
}

worker.onerror = (event) => trouble(`This page cannot simulate: ${event.message}`);
worker.onmessage = ({ data: message }) => {
  if (message.error) return trouble(`This page cannot simulate: ${message.error}`);
  if (message.analysis) return analysis({ ...message.analysis, id: message.id });
  const partial = message.progress !== undefined;
  $("progress").hidden = !partial;
  $("progress").value = message.progress || 0;
  live.run = message;
  trouble(message.fault && `${message.fault}. The charts end there; try other values.`);
  const [step, spent] = [seconds, message.seconds].map((time) => quantity(time, "s"));
  if (!partial) write($("status"), `${data.steps} steps of ${step} in ${spent}`);
  redraw();
};

async function begin() {
  worker.postMessage({ data, address: location.href.split(/[?#]/)[0], module: await inflated("module") });
  ask();
}

// -- drawing

function point(time) {
  view.cursor = time;
  redraw();
}

function redraw() {
  if (planned || !live.run) return;
  planned = true;
  requestAnimationFrame(() => {
    planned = false;
    const { run } = live, isWhole = run.progress === undefined;
    for (const chart of charts) chart.show(run, kept);
    const now = Math.min(view.hover ?? view.cursor ?? Infinity, run.time[run.time.length - 1]);
    write($("now"), `${quantity(now)} s`);
    $("cursor").value = now / end;
    update(now);
    live.redraws += 1;
    document.body.dataset.state = "ready";
    if (!isWhole) return;
    table();
    document.body.dataset.shown = run.id;
  });
}

/** Step metrics: last value; if it is settled, rise time from 10 to 90 %, overshoot, settling time to 2 %. */
function metrics(time, values) {
  const last = values.length - 1, first = values[0], steady = values[last], span = steady - first;
  const shares = values.map((value) => (value - first) / span);
  const [ten, ninety] = [0.1, 0.9].map((level) => shares.findIndex((share) => share >= level));
  const settled = shares.findLastIndex((share) => !(Math.abs(share - 1) <= 0.02)) + 1;
  const largest = (a, b) => Math.max(a, Math.abs(b)), size = values.reduce(largest, 0);
  const peak = shares.reduce((a, b) => Math.max(a, b), 1);
  const settles = settled < 0.9 * last && Math.abs(span) > 1e-9 * size;
  const end = Math.abs(steady) < 1e-6 * size ? 0 : steady;
  const overshoot = Math.round(1e4 * (peak - 1)) / 100; // to 0.01 %
  const found = [time[ninety] - time[ten], overshoot, time[settled] - time[0]];
  return [end, ...found.map((value) => (settles ? value : NaN))];
}

/** Fill a table with rows of texts; the first row and the first column are headings. */
function fill(table, rows) {
  table.replaceChildren(...rows.map((texts, r) => {
    const row = element("tr");
    row.append(...texts.map((text, i) => element(r && i ? "td" : "th", "", text)));
    return row;
  }));
}

function table() {
  const key = `${live.run.id}, ${kept?.id}`;
  if (!curves.length || live.listed === key) return;
  live.listed = key;
  const rows = curves.map(({ label, unit, values }) => {
    const [now, before] = [live.run, kept].map((run) => run && metrics(run.time, values(run)));
    return [label, ...[unit, "s", "%", "s"].map((of, k) =>
      quantity(now[k], of) + (before ? ` (${quantity(before[k], of)})` : ""))];
  });
  fill($("metrics"), [["signal", "last value", "rise time", "overshoot", "settling time"], ...rows]);
}

// -- the loop

const sweep = { label: "frequency", unit: "rad/s", log: true, cursor: null, range: null, changed: bode };
const plots = [];
if (data.loop) {
  for (const [label, unit] of [["magnitude", "dB"], ["phase", "°"]]) {
    const curves = [{ label, values: (loop) => loop[label] }];
    plots.push(new Chart($("analysis"), { title: `${label} of the loop gain`, unit, curves }, sweep));
  }
  $("loop").hidden = false;
  $("wire").textContent = `Loop opened at ${data.loop.name}`;
  $("point").onchange = ask;
}

function bode() {
  if (live.loop) for (const plot of plots) plot.show({ ...live.loop, time: live.loop.omega });
}

function analysis(found) {
  live.loop = found;
  const decibel = (factor) => `${quantity(20 * Math.log10(factor))} dB`, none = "–", { stable } = found;
  fill($("margins"), stable ? [
    ["margins", ""],
    ["gain up", found.up < Infinity ? decibel(found.up) : "∞"],
    ["gain down", found.down > 0 ? decibel(found.down) : "∞"],
    ["phase", found.angle < Infinity ? `${quantity(found.angle)}°` : none],
    ["delay", found.delay < Infinity ? quantity(found.delay, "s") : none],
    ["crossover", found.crossover > 0 ? `${quantity(found.crossover)} rad/s` : none],
  ] : [["the closed loop is unstable"]]);
  $("margins").className = stable ? "" : "unstable";
  const real = ([x, y]) => [x, Math.abs(y) < 1e-6 * Math.abs(x) ? 0 : y];
  const upper = found.poles.map(real).filter(([, y]) => y >= 0).sort((a, b) => b[0] - a[0]);
  const rows = upper.slice(0, 10).map(([x, y]) => {
    const size = Math.hypot(x, y), pole = quantity(x) + (y > 0 ? ` ± ${quantity(y)}j` : "");
    return [pole, `${quantity(size)} rad/s`, quantity(size ? -x / size : 1)];
  });
  fill($("list"), [["slowest closed-loop poles", "frequency", "damping"], ...rows]);
  bode();
}

// -- sliders

const controls = data.controls.map((control) => {
  const { name, low, high, log, place, min, max } = control, box = element("div", "control");
  const head = element("div", "head"), label = element("label", "", name.replace(/[._]/g, "$&\u200b"));
  const slider = Object.assign(element("input"), { type: "range", max: 1000, ariaLabel: name });
  const field = element("input"), reset = element("button", "", "↺");
  Object.assign(field, { type: "number", min, max, step: "any", ariaLabel: `${name}, number` });
  const set = (value) => {
    p[place] = value;
    slider.value = 1000 * shareOf(value, low, high, log);
    field.value = Number(value.toPrecision(4));
    box.classList.toggle("changed", value !== defaults[place]);
  };
  const change = (value) => {
    set(value);
    ask();
    remember();
  };
  label.title = box.title = control.meaning;
  reset.title = slider.title = `double-click the slider or press ↺ for ${defaults[place]}`;
  reset.onclick = slider.ondblclick = () => change(defaults[place]);
  slider.oninput = () => change(Number(valueAt(slider.value / 1000, low, high, log).toPrecision(4)));
  field.onchange = () => { if (field.value && field.checkValidity()) change(Number(field.value)); };
  head.append(label, field, element("span", "unit", control.unit), reset);
  box.append(head, slider);
  $("controls").append(box);
  return { ...control, set, field };
});

// -- values in the address

let later = 0;
function remember() {
  clearTimeout(later);
  later = setTimeout(() => history.replaceState(null, "", address()), 200);
}

const changed = () => controls.filter(({ place }) => p[place] !== defaults[place]);

function address() {
  const values = new URLSearchParams(changed().map(({ name, place }) => [name, p[place]]));
  return `${location.pathname}${location.search}#${values}`;
}

function recall() {
  const values = new URLSearchParams(location.hash.slice(1));
  for (const { name, place, field, set } of controls) {
    field.value = values.get(name);
    set(field.value && field.checkValidity() ? Number(field.value) : defaults[place]);
  }
  view.cursor = view.range = null;
}

/** Return the call of simulate that repeats the run. */
function python() {
  const nested = (start, [size, ...shape]) => (size === undefined ? p[start]
    : Array.from({ length: size }, (_, i) => nested(start + i * shape.reduce((a, b) => a * b, 1), shape)));
  const { arrays, tick, every } = data, log = Object.fromEntries(data.channels);
  const parameters = {};
  for (const { array } of changed()) parameters[array] = nested(arrays[array][0], arrays[array].slice(1));
  const settings = { step: seconds, solver: "rk4", log, log_step: (every * tick[0]) / tick[1], parameters };
  const lines = Object.entries(settings).map(([name, value]) => `    ${name}=${JSON.stringify(value)},\n`);
  const call = `simulate(\n    diagram,\n    ${end},\n${lines.join("")})`;
  return `from trussflow.blocks import simulate\n\nresult = ${call}\n`;
}
Object.assign(live, { metrics, python, address });

// -- buttons, cursor and panels

$("python").onclick = async () => {
  try {
    await navigator.clipboard.writeText(python());
    write($("status"), "copied");
  } catch {
    window.prompt("copy this text", python()); // no clipboard for pages from disk in some browsers
  }
};
$("reset").onclick = () => { history.replaceState(null, "", "#"); recall(); ask(); };
$("keep").onclick = () => {
  kept = kept || live.run.progress !== undefined ? null : live.run;
  $("keep").textContent = kept ? "forget" : "keep";
  redraw();
};
$("cursor").oninput = () => point($("cursor").value * end);
player($("play"), (passed) => {
  point(view.cursor >= end ? 0 : Math.min(end, view.cursor + passed));
  return view.cursor < end;
});

window.trussflowPanels = [];
for (const script of data.panels) document.body.append(element("script", "", script));
const panels = window.trussflowPanels.filter((panel) => {
  const box = element("div", "panel");
  $("panels").append(box);
  try {
    panel.mount(box, data);
  } catch (error) { // as without WebGL; the other parts of the page work
    box.textContent = `This view cannot be shown: ${error}`;
    return false;
  }
  return true;
});

function update(time) {
  if (!panels.length) return;
  const row = indexOf(live.run.time, time) * data.width;
  const values = (places) => places.map((place) => live.run.log[row + place]);
  const signals = Object.fromEntries(data.channels.map(([name, , places]) => [name, values(places)]));
  for (const panel of panels) panel.update(time, signals);
}

window.onhashchange = () => { recall(); ask(); };
recall();
begin().catch((error) => trouble(`This page cannot simulate: ${error}`));
