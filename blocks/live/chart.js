"use strict";
// Charts on canvas: axes with SI prefixes, decimated curves, cursor, zoom in x, a kept run behind.

const COLOURS = ["#2563eb", "#dc2626", "#16a34a", "#d97706", "#9333ea", "#0891b2", "#db2777", "#65a30d"];
const PREFIXES = { "-12": "p", "-9": "n", "-6": "µ", "-3": "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T" };
const PREFIXABLE = /^(m|s|N|rad|Pa|J|W|A|V|Hz|K|g)(?![\w²³⁴^½])/; // a square of a prefixed unit is another unit

/** Return a number with four digits. */
function short(value) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-3 || size >= 1e5)) return value.toExponential(2).replace("e", "·10^").replace("+", "");
  return String(Number(value.toPrecision(4)));
}

/** Return the factor and the unit in which numbers up to `size` are shown. */
function scaled(size, unit) {
  const power = size > 0 && Number.isFinite(size) ? 3 * Math.floor(Math.log10(size * 1.000001) / 3) : 0;
  if (PREFIXABLE.test(unit) && power in PREFIXES) return [10 ** -power, PREFIXES[power] + unit];
  if (power > 3 || power < -3) return [10 ** -power, `10^${power}${unit && " "}${unit}`];
  return [1, unit];
}

/** Return a number with its unit and prefix. */
function quantity(value, unit) {
  if (!Number.isFinite(value)) return "–";
  const [factor, shown] = PREFIXABLE.test(unit) ? scaled(Math.abs(value), unit) : [1, unit];
  return `${short(value * factor)}${shown && " "}${shown}`;
}

/** Return round numbers between two ends. */
function ticks(low, high, most) {
  const raw = (high - low) / most, power = 10 ** Math.floor(Math.log10(raw));
  const step = power * [1, 2, 5, 10].find((f) => f * power >= raw * 0.999);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; ++k) found.push(Number((k * step).toPrecision(12)));
  return found;
}

/** Return the last index whose value is not above `wanted`, in an ascending array. */
function indexOf(values, wanted) {
  let low = 0, high = values.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (values[middle] <= wanted) low = middle; else high = middle - 1;
  }
  return low;
}

function element(tag, className = "", text = "") {
  const made = document.createElement(tag);
  made.className = className;
  made.textContent = text;
  return made;
}

/** Write a text if it is new: each change costs a layout. */
function write(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

/** Chart of curves over one variable.

 * `view` is shared by charts of one variable: {label, unit, log, range, cursor, changed()}. A curve has a label and
 * `values(run)`, and `run.time` are the places; `show(run, kept)` draws. */
class Chart {
  constructor(parent, { title, unit, curves }, view) {
    Object.assign(this, { unit, curves, view });
    this.box = element("div", "chart");
    this.canvas = element("canvas");
    this.legend = element("div", "legend");
    this.box.append(element("h2", "", title), this.canvas, this.legend);
    this.readouts = curves.map(({ label, brief }, i) => {
      const item = element("span"), mark = element("i"), value = element("b");
      mark.style.background = COLOURS[i % COLOURS.length];
      item.append(mark, `${brief ?? label} `, value);
      this.legend.append(item);
      return value;
    });
    parent.append(this.box);
    this.listen();
  }

  listen() {
    const { canvas, view } = this;
    let from = null;
    const at = (event) => this.inverse(event.clientX - canvas.getBoundingClientRect().left);
    canvas.onpointerdown = (event) => {
      from = event.clientX;
      canvas.setPointerCapture(event.pointerId);
    };
    canvas.onpointermove = (event) => {
      this.drag = from !== null && Math.abs(event.clientX - from) > 5
        ? [this.inverse(from - canvas.getBoundingClientRect().left), at(event)].sort((a, b) => a - b) : null;
      view.hover = at(event);
      view.changed();
    };
    canvas.onpointerup = (event) => {
      if (this.drag && this.drag[1] > this.drag[0]) view.range = this.drag;
      else if (from !== null && view.pick) view.pick(at(event));
      from = this.drag = null;
      view.changed();
    };
    canvas.onpointerleave = () => { view.hover = null; view.changed(); };
    canvas.ondblclick = () => { view.range = null; view.changed(); };
  }

  place(value) {
    const low = this.ends[0], high = this.ends[1], log = this.view.log;
    const share = log ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
    return 58 + share * (this.width - 70);
  }

  inverse(pixel) {
    const [low, high] = this.ends || [0, 1], share = Math.min(1, Math.max(0, (pixel - 58) / (this.width - 70)));
    return this.view.log ? low * (high / low) ** share : low + (high - low) * share;
  }

  show(run, kept) {
    this.run = run;
    const { canvas, view } = this, ratio = window.devicePixelRatio || 1;
    const width = (this.width = canvas.clientWidth), height = (this.height = canvas.clientHeight);
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const g = canvas.getContext("2d", { willReadFrequently: true }), style = getComputedStyle(document.documentElement);
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    g.clearRect(0, 0, width, height);
    g.font = "12px system-ui, sans-serif";
    const time = run.time;
    this.ends = view.range || [time[0], view.end || time[time.length - 1]];
    if (!(this.ends[1] > this.ends[0])) this.ends = [this.ends[0], this.ends[0] + 1];
    const lines = [run, ...(kept ? [kept] : [])].map((one) => this.curves.map((curve) => this.line(one.time, curve.values(one))));
    let low = Infinity, high = -Infinity;
    for (const line of lines.flat()) {
      low = Math.min(low, line.low);
      high = Math.max(high, line.high);
    }
    if (!(high >= low)) [low, high] = [0, 1];
    if (run.fault) { // the last rows before a fault would hide all others
      const sizes = this.curves.flatMap((curve) => Array.from(curve.values(run), Math.abs)).sort((a, b) => a - b);
      const most = 10 * sizes[Math.floor(0.9 * sizes.length)] || 1;
      [low, high] = [Math.max(low, -most), Math.min(high, most)];
    }
    // A curve that is constant but for round-off is flat.
    const size = Math.max(Math.abs(low), Math.abs(high)), least = size * 1e-9 || 1;
    if (high - low < least) [low, high] = [low - (size || 1) * 0.1, high + (size || 1) * 0.1];
    const edge = 0.06 * (high - low), bottom = height - 34;
    [low, high] = [low - edge, high + edge];
    const y = (v) => 6 + ((high - v) / (high - low)) * (bottom - 6);
    this.grid(g, style, low, high, y, bottom);
    g.save();
    g.beginPath();
    g.rect(58, 2, width - 68, bottom);
    g.clip();
    lines.forEach((group, n) => group.forEach((line, i) => {
      g.strokeStyle = COLOURS[i % COLOURS.length];
      g.lineWidth = n ? 1.2 : 1.7;
      g.globalAlpha = n ? 0.6 : 1;
      g.setLineDash(n ? [5, 4] : []);
      g.beginPath();
      for (let k = 0; k < line.points.length; k += 2) g.lineTo(line.points[k], y(line.points[k + 1]));
      g.stroke();
    }));
    g.restore();
    const cursor = view.hover ?? view.cursor;
    if (this.drag) {
      g.fillStyle = style.getPropertyValue("--accent") + "33";
      g.fillRect(this.place(this.drag[0]), 6, this.place(this.drag[1]) - this.place(this.drag[0]), bottom - 6);
    }
    if (cursor != null && cursor >= this.ends[0] && cursor <= this.ends[1]) {
      g.strokeStyle = style.getPropertyValue("--quiet");
      g.lineWidth = 1;
      g.beginPath();
      g.moveTo(this.place(cursor), 6);
      g.lineTo(this.place(cursor), bottom);
      g.stroke();
    }
    const row = cursor == null ? time.length - 1 : indexOf(time, cursor);
    this.readouts.forEach((readout, i) => write(readout, quantity(this.curves[i].values(run)[row], this.unit)));
  }

  /** Return the points of a curve, at most a least and a largest one in each pixel, and its ends. */
  line(time, values) {
    const points = [], [from, to] = this.ends;
    const first = Math.max(0, indexOf(time, from)), last = Math.min(time.length - 1, indexOf(time, to) + 1);
    let low = Infinity, high = -Infinity, pixel = NaN, least = 0, most = 0;
    const flush = () => {
      if (Number.isNaN(pixel)) return;
      for (const i of least === most ? [least] : least < most ? [least, most] : [most, least]) points.push(this.place(time[i]), values[i]);
    };
    for (let i = first; i <= last; ++i) {
      const v = values[i], here = Math.floor(this.place(time[i]));
      if (!Number.isFinite(v)) continue;
      if (v < low) low = v;
      if (v > high) high = v;
      if (here !== pixel) {
        flush();
        pixel = here;
        least = most = i;
      } else if (v < values[least]) least = i;
      else if (v > values[most]) most = i;
    }
    flush();
    return { points, low, high };
  }

  grid(g, style, low, high, y, bottom) {
    const { view, width } = this, [factor, unit] = scaled(Math.max(Math.abs(low), Math.abs(high)), this.unit);
    g.strokeStyle = style.getPropertyValue("--line");
    g.fillStyle = style.getPropertyValue("--quiet");
    g.lineWidth = 1;
    g.textAlign = "right";
    g.textBaseline = "middle";
    for (const tick of ticks(low * factor, high * factor, 5)) {
      const py = Math.round(y(tick / factor)) + 0.5;
      g.beginPath();
      g.moveTo(58, py);
      g.lineTo(width - 12, py);
      g.stroke();
      g.fillText(String(tick), 53, py);
    }
    g.textAlign = "center";
    g.textBaseline = "top";
    const [from, to] = this.ends;
    const along = view.log ? ticks(Math.log10(from), Math.log10(to), 7).filter(Number.isInteger).map((e) => 10 ** e) : ticks(from, to, 7);
    for (const tick of along) {
      const px = Math.round(this.place(tick)) + 0.5;
      g.beginPath();
      g.moveTo(px, 6);
      g.lineTo(px, bottom);
      g.stroke();
      g.fillText(String(Number(tick.toPrecision(6))), px, bottom + 4);
    }
    g.fillText(`${view.label} [${view.unit}]`, 58 + (width - 70) / 2, bottom + 19);
    g.save();
    g.translate(9, bottom / 2);
    g.rotate(-Math.PI / 2);
    g.textBaseline = "middle";
    g.fillText(unit ? `[${unit}]` : "", 0, 0);
    g.restore();
  }
}
