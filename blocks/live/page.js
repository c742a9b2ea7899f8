// The page: sliders ask the worker for runs, and charts, metrics and panels show the latest one.

const data = JSON.parse(document.getElementById("data").textContent);
const seconds = data.tick[0] / data.tick[1];
const bytesOf = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
const defaults = new Float64Array(bytesOf(data.numbers).buffer).slice(0, data.sizes[0]);
const p = defaults.slice();
const live = (window.trussflowLive = { redraws: 0, run: null, data, p });
let steps = data.steps, kept = null, asked = 0, playing = 0, planned = false;
const view = { label: "time", unit: "s", cursor: null, range: null, changed: redraw, pick: (time) => { view.cursor = time; redraw(); } };

/** Return the function of a run that gives a column of its log. */
const column = (index) => (run) => {
  run.columns ??= [];
  if (run.columns[index]) return run.columns[index];
  const values = (run.columns[index] = new Float64Array(run.time.length));
  for (let i = 0; i < values.length; ++i) values[i] = run.log[i * data.width + index];
  return values;
};
const charts = data.charts.map(({ title, unit, scalar, curves }) => {
  const drawn = curves.map((curve) => ({ ...curve, unit, scalar, values: column(curve.column) }));
  return new Chart($("charts"), { title, unit, curves: drawn }, view);
});
const curves = charts.flatMap((chart) => chart.curves).filter(({ scalar }) => scalar);

// -- the worker

const worker = new Worker(URL.createObjectURL(new Blob([$("worker").textContent], { type: "text/javascript" })));

function ask() {
  worker.postMessage({ id: ++asked, p, steps, point: $("point").value });
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
  view.ends = [message.time[0], steps * seconds];
  trouble(message.fault && `${message.fault}. The charts end there; try other values.`);
  if (!partial) write($("status"), `${steps} steps of ${quantity(seconds, "s")} in ${quantity(message.seconds, "s")}`);
  redraw();
};

async function begin() {
  const packed = new Blob([bytesOf($("module").textContent)]).stream().pipeThrough(new DecompressionStream("deflate"));
  worker.postMessage({ data, address: location.href.split(/[?#]/)[0], module: await new Response(packed).arrayBuffer() });
  ask();
}

// -- drawing

function redraw() {
  if (planned || !live.run) return;
  planned = true;
  requestAnimationFrame(() => {
    planned = false;
    for (const chart of charts) chart.show(live.run, kept);
    if (live.run.progress === undefined) table();
    const now = Math.min(view.hover ?? view.cursor ?? Infinity, live.run.time[live.run.time.length - 1]);
    write($("now"), `${quantity(now)} s`);
    $("cursor").value = now / (steps * seconds);
    update(now);
    live.redraws += 1;
    document.body.dataset.state = "ready";
    if (live.run.progress === undefined) document.body.dataset.shown = live.run.id;
  });
}

/** Step metrics: last value, rise time from 10 to 90 %, overshoot, settling time to 2 %; without a settled end only the first. */
function metrics(time, values) {
  const last = values.length - 1, first = values[0], steady = values[last], span = steady - first;
  let ten = -1, ninety = -1, settled = 0, peak = 1, size = 0;
  for (let i = 0; i <= last; ++i) {
    const share = (values[i] - first) / span;
    if (ten < 0 && share >= 0.1) ten = i;
    if (ninety < 0 && share >= 0.9) ninety = i;
    if (!(Math.abs(share - 1) <= 0.02)) settled = i + 1;
    if (share > peak) peak = share;
    size = Math.max(size, Math.abs(values[i]));
  }
  const end = Math.abs(steady) < 1e-6 * size ? 0 : steady, settles = settled < 0.9 * last && Math.abs(span) > 1e-9 * size;
  if (!settles) return { steady: end, rise: NaN, overshoot: NaN, settling: NaN };
  const overshoot = Math.round(1e4 * (peak - 1)) / 100; // to 0.01 %
  return { steady: end, rise: time[ninety] - time[ten], overshoot, settling: time[settled] - time[0] };
}
live.metrics = metrics;

const rows = curves.map(({ label }) => {
  const row = element("tr"), cells = Array.from({ length: 4 }, () => element("td"));
  row.append(element("th", "", label), ...cells);
  return [row, cells];
});
const titles = element("tr");
titles.append(...["signal", "last value", "rise time", "overshoot", "settling time"].map((title) => element("th", "", title)));
if (rows.length) $("metrics").append(titles, ...rows.map(([row]) => row));

function table() {
  curves.forEach(({ unit, values }, i) => {
    const [now, before] = [live.run, kept].map((run) => run && (run.metrics ??= {}) && (run.metrics[i] ??= metrics(run.time, values(run))));
    [["steady", unit], ["rise", "s"], ["overshoot", "%"], ["settling", "s"]].forEach(([name, of], k) => {
      write(rows[i][1][k], quantity(now[name], of) + (before ? ` (${quantity(before[name], of)})` : ""));
    });
  });
}

// -- the loop

const sweep = { label: "frequency", unit: "rad/s", log: true, cursor: null, range: null, changed: () => bode() };
const plots = data.loop ? [["magnitude", "dB"], ["phase", "°"]].map(([title, unit]) =>
  new Chart($("analysis"), { title: `${title} of the loop gain`, unit, curves: [{ label: title, values: (loop) => loop[title] }] }, sweep)) : [];
if (data.loop) {
  $("loop").hidden = false;
  $("wire").textContent = `Loop opened at ${data.loop.name}`;
  $("point").onchange = ask;
}

function bode() {
  if (live.loop) for (const plot of plots) plot.show({ ...live.loop, time: live.loop.omega });
}

function lines(table, titles, cells) {
  const row = (kind, texts) => {
    const made = element("tr");
    made.append(...texts.map((text, i) => element(i ? kind : "th", "", text)));
    return made;
  };
  table.replaceChildren(row("th", titles), ...cells.map((texts) => row("td", texts)));
}

function analysis(found) {
  live.loop = found;
  const decibel = (factor) => `${quantity(20 * Math.log10(factor))} dB`, none = "–", { stable } = found;
  lines($("margins"), ["margins", ""], stable ? [
    ["gain up", found.up < Infinity ? decibel(found.up) : "∞"],
    ["gain down", found.down > 0 ? decibel(found.down) : "∞"],
    ["phase", found.angle < Infinity ? `${quantity(found.angle)}°` : none],
    ["delay", found.delay < Infinity ? quantity(found.delay, "s") : none],
    ["crossover", found.crossover > 0 ? `${quantity(found.crossover)} rad/s` : none],
  ] : [["the closed loop is unstable", ""]]);
  $("margins").className = stable ? "" : "unstable";
  const upper = found.poles.map(([x, y]) => [x, Math.abs(y) < 1e-6 * Math.abs(x) ? 0 : y]).filter(([, y]) => y >= 0).sort((a, b) => b[0] - a[0]).slice(0, 10);
  lines($("list"), ["slowest closed-loop poles", "frequency", "damping"], upper.map(([x, y]) => {
    const size = Math.hypot(x, y);
    return [`${quantity(x)}${y > 0 ? ` ± ${quantity(y)}j` : ""}`, `${quantity(size)} rad/s`, quantity(size ? -x / size : 1)];
  }));
  bode();
}

// -- sliders

const controls = data.controls.map((control) => {
  const { low, high, log, place, bounds } = control, box = element("div", "control"), head = element("div", "head");
  const label = element("label", "", control.name.replace(/[._]/g, "$&\u200b")), slider = element("input"), field = element("input");
  const unit = element("span", "unit", control.unit);
  [slider.type, field.type, field.step] = ["range", "number", "any"];
  Object.assign(slider, { min: 0, max: 1000, step: 1 });
  label.title = box.title = control.meaning;
  slider.setAttribute("aria-label", control.name);
  field.setAttribute("aria-label", `${control.name}, number`);
  const allowed = (v) => Number.isFinite(v) && !("at least" in bounds && v < bounds["at least"]) && !("above" in bounds && v <= bounds.above)
    && !("at most" in bounds && v > bounds["at most"]) && !("below" in bounds && v >= bounds.below);
  const set = (value) => {
    field.classList.toggle("refused", !allowed(value));
    if (!allowed(value)) return;
    p[place] = value;
    show();
    ask();
    remember();
  };
  const show = () => {
    const share = log ? Math.log(p[place] / low) / Math.log(high / low) : (p[place] - low) / (high - low);
    slider.value = 1000 * share;
    field.value = Number(p[place].toPrecision(4));
    box.classList.toggle("changed", p[place] !== defaults[place]);
  };
  slider.oninput = () => {
    const share = slider.value / 1000;
    set(Number((log ? low * (high / low) ** share : low + (high - low) * share).toPrecision(4)));
  };
  field.onchange = () => set(field.value === "" ? NaN : Number(field.value));
  const reset = element("button", "", "↺");
  reset.title = slider.title = `double-click the slider or press ↺ for ${defaults[place]}`;
  reset.onclick = slider.ondblclick = () => set(defaults[place]);
  head.append(label, field, unit, reset);
  box.append(head, slider);
  $("controls").append(box);
  return { ...control, set, show, allowed };
});

// -- values in the address

let later = 0;
function remember() {
  clearTimeout(later);
  later = setTimeout(() => history.replaceState(null, "", address()), 200);
}

function address() {
  const changed = new URLSearchParams(controls.filter(({ place }) => p[place] !== defaults[place]).map(({ name, place }) => [name, p[place]]));
  if (steps !== data.steps) changed.set("duration", steps * seconds);
  return `${location.pathname}${location.search}#${changed}`;
}

function recall() {
  const said = new URLSearchParams(location.hash.slice(1));
  for (const { name, place, allowed } of controls) {
    const value = Number(said.get(name));
    p[place] = said.get(name) && allowed(value) ? value : defaults[place];
  }
  span(Number(said.get("duration")) || data.steps * seconds);
  for (const control of controls) control.show();
}

function span(duration) {
  if (duration > 0) steps = Math.max(1, Math.round(duration / seconds));
  $("duration").value = Number((steps * seconds).toPrecision(12));
  view.cursor = view.range = null;
}

/** Return the call of simulate that repeats the run. */
function python() {
  const list = ([start, ...shape]) => {
    if (!shape.length) return String(p[start]);
    const inner = shape.slice(1), size = inner.reduce((a, b) => a * b, 1);
    return `[${Array.from({ length: shape[0] }, (_, i) => list([start + i * size, ...inner])).join(", ")}]`;
  };
  const changed = new Set(controls.filter(({ place }) => p[place] !== defaults[place]).map(({ array }) => array));
  const values = [...changed].map((name) => `        ${JSON.stringify(name)}: ${list(data.arrays[name])},\n`).join("");
  return `from trussflow.blocks import simulate\n\nresult = simulate(\n    diagram,\n    ${steps * seconds},\n    step=${seconds},\n`
    + `    solver=${JSON.stringify(data.solver)},\n    log=${JSON.stringify(data.logged)},\n    log_step=${(data.every * Math.ceil(steps / data.steps) * data.tick[0]) / data.tick[1]},\n`
    + `${values && `    parameters={\n${values}    },\n`})\n`;
}
Object.assign(live, { python, address });


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
$("duration").onchange = () => { span(Number($("duration").value)); ask(); remember(); };
$("cursor").oninput = () => { view.cursor = $("cursor").value * steps * seconds; redraw(); };

function play() {
  cancelAnimationFrame(playing);
  playing = playing ? 0 : -1;
  $("play").textContent = playing ? "❚❚" : "▶";
  if (!playing) return;
  const end = steps * seconds;
  let before = performance.now();
  if (view.cursor === null || view.cursor >= end) view.cursor = 0;
  const frame = (now) => {
    view.cursor = Math.min(end, view.cursor + (now - before) / 1000);
    before = now;
    redraw();
    playing = requestAnimationFrame(frame);
    if (view.cursor >= end) play();
  };
  playing = requestAnimationFrame(frame);
}
$("play").onclick = play;

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
  const signals = Object.fromEntries(data.panelSignals.map(([name, places]) => [name, places.map((place) => live.run.log[row + place])]));
  for (const panel of panels) panel.update(time, signals);
}

window.onhashchange = () => { recall(); ask(); };
matchMedia("(prefers-color-scheme: dark)").onchange = () => { redraw(); bode(); };
recall();
begin().catch((error) => trouble(`This page cannot simulate: ${error}`));
