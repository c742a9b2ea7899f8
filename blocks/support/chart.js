"use strict";
// Charts on canvas over one variable: axes with SI prefixes, equal curves, cursor, zoom, a second run.

// Okabe and Ito (2008), and two that are visible on light and on dark ground.
const COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8a8a8a", "#a16207"];
const DASHES = [[], [7, 3], [2, 2.5], [8, 3, 2, 3]]; // of curves that have one colour
const PIECE = 9; // of each curve in a line that several curves share [px]
const PREFIXES = { "-12": "p", "-9": "n", "-6": "µ", "-3": "m", 3: "k", 6: "M", 9: "G", 12: "T" };
// A square of a prefixed unit is another unit.
const PREFIXABLE = /^(m|s|N|rad|Pa|J|W|A|V|Hz|K|g)(?![\w²³⁴^½]|.*,)/;
const ONLY_SMALL = /^(s|rad)/; // units without prefixes for large numbers

/** Return the factor and the unit in which numbers up to `size` are shown. */
function scaled(size, unit) {
  if (!(size > 0 && size < Infinity) || (size >= 0.1 && size < 1e4)) return [1, unit];
  const power = 3 * Math.floor(Math.log10(size) / 3 + 1e-9), factor = 10 ** -power;
  const fits = PREFIXABLE.test(unit) && !(power > 0 && ONLY_SMALL.test(unit));
  if (fits && power in PREFIXES) return [factor, PREFIXES[power] + unit];
  const raised = String(power).replace(/./g, (c) => (c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[c]));
  return [factor, `10${raised} ${unit}`.trim()];
}

/** Return a number of four digits with its unit and prefix. */
function quantity(value, unit = "") {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value), [factor, shown] = scaled(size, unit);
  const text = (number) => Number(number.toPrecision(4));
  if (!shown.startsWith("10")) return `${text(value * factor)} ${shown}`.trim();
  return size >= 1e-3 && size < 1e5 ? `${text(value)} ${unit}`.trim() : `${text(value * factor)}·${shown}`;
}

const signed = (number) => String(number).replace("-", "−");

/** Return round numbers between two ends. */
function ticks(low, high, most) {
  const raw = (high - low) / most, power = 10 ** Math.floor(Math.log10(raw));
  const step = power * [1, 2, 5, 10].find((f) => f * power >= raw * 0.999);
  const first = Math.ceil(low / step - 1e-9), last = Math.floor(high / step + 1e-9);
  return Array.from({ length: last - first + 1 }, (_, k) => Number(((first + k) * step).toPrecision(12)));
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

const $ = (id) => document.getElementById(id);

function element(tag, className = "", text = "") {
  const made = document.createElement(tag);
  made.className = className;
  made.textContent = text;
  return made;
}

/** Return the place of a value between two ends, from 0 to 1, and the value at a place. */
const shareOf = (value, low, high, log) =>
  (log ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low));
const valueAt = (share, low, high, log) => (log ? low * (high / low) ** share : low + (high - low) * share);

const bytesOf = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

/** Reviver of JSON.parse: packed arrays become numbers, or lists of rows. */
function unpacked(_, value) {
  if (value?.packed === undefined) return value;
  const [count, columns] = value.shape, size = count * (columns ?? 1);
  const planes = bytesOf(value.packed), bytes = new Uint8Array(8 * size), least = 8 - planes.length / size;
  for (let k = least; k < 8; ++k)
    for (let i = 0; i < size; ++i) bytes[8 * i + k] = planes[(k - least) * size + i];
  const numbers = new Float64Array(bytes.buffer);
  const row = (_, i) => numbers.subarray(i * columns, (i + 1) * columns);
  return columns === undefined ? numbers : Array.from({ length: count }, row);
}

/** Return the bytes of a compressed element of the page. */
async function inflated(id) {
  const packed = new Blob([bytesOf($(id).textContent)]).stream();
  const stream = packed.pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** Let a button play: in each frame, `advance` gets the seconds since the last; false ends the play. */
function player(button, advance) {
  let last = null; // the time of the last frame, while it plays
  const set = (time) => {
    last = time;
    button.textContent = time === null ? "▶" : "❚❚";
  };
  const frame = (now) => {
    if (last === null) return;
    set(advance(Math.max(0, now - last) / 1000) ? now : null);
    requestAnimationFrame(frame);
  };
  button.onclick = () => {
    if (last !== null) return set(null);
    set(performance.now());
    requestAnimationFrame(frame);
  };
}

/** Write a text if it is new: each change costs a layout. */
function write(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

/** Return lists of the lines that lie on each other within a tolerance. */
function equalLines(lines, tolerance) {
  const groups = [];
  for (const line of lines) {
    const group = line.points.length && groups.find(([{ values, first, last }]) => {
      for (let k = first; k <= last; ++k) {
        const a = values[k], b = line.values[k];
        if (Math.abs(a - b) > tolerance || Number.isFinite(a) !== Number.isFinite(b)) return false;
      }
      return true;
    });
    if (group) group.push(line); else groups.push([line]);
  }
  return groups;
}

/** Draw a path in the colours of equal lines, which alternate along it. */
function stroke(g, group, path) {
  group.forEach(({ curve }, k) => {
    g.strokeStyle = curve.colour;
    g.lineDashOffset = -k * PIECE;
    g.setLineDash(group.length > 1 ? [PIECE, PIECE * (group.length - 1)] : curve.dash);
    g.beginPath();
    path();
    g.stroke();
  });
}

/** Chart of curves over one variable.

 * `view` is shared by charts of one variable: {label, unit, log, ends, range, cursor, hover, pick(value),
 * changed(all)}; `all` says that the range is new, otherwise only the cursor. A curve has a label, perhaps a
 * colour, and `values(run)`, and `run.time` are the places; `show(run, kept)` draws. */
class Chart {
  constructor(parent, { title = "", unit, curves }, view) {
    const colours = curves.map(({ colour }, i) => colour ?? COLOURS[i % COLOURS.length]);
    const before = (i) => colours.slice(0, i).filter((colour) => colour === colours[i]).length;
    this.curves = curves.map((curve, i) =>
      ({ ...curve, colour: colours[i], dash: DASHES[before(i) % DASHES.length] }));
    Object.assign(this, { parent, unit, view, names: "", readouts: [] });
    const box = element("div", "chart"), axes = element("div", "axes");
    this.canvas = element("canvas");
    this.cursor = element("div", "cursor");
    this.band = element("div", "band");
    this.legend = element("div", "legend");
    this.cursor.hidden = this.band.hidden = true;
    axes.append(this.canvas, this.cursor, this.band);
    if (title) box.append(element("h2", "", title));
    box.append(axes, this.legend);
    parent.append(box);
    this.listen();
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  }

  listen() {
    const { canvas, band, view } = this;
    let from = null; // where a drag began
    const range = () => [from, view.hover].sort((a, b) => a - b);
    const end = () => {
      from = null;
      band.hidden = true;
    };
    canvas.onpointerdown = (event) => {
      from = view.hover = this.inverse(event.offsetX);
      canvas.setPointerCapture(event.pointerId);
    };
    canvas.onpointermove = (event) => {
      view.hover = this.inverse(event.offsetX);
      const [left, right] = range().map((value) => this.place(value));
      band.hidden = from === null || right - left < 5;
      Object.assign(band.style, { left: `${left}px`, width: `${right - left}px` });
      view.changed();
    };
    canvas.onpointerup = () => {
      if (!band.hidden) view.range = range();
      else if (from !== null) view.pick?.(view.hover);
      end();
      view.changed(true);
    };
    canvas.onpointercancel = end; // a finger scrolls the page
    canvas.onpointerleave = () => { view.hover = null; view.changed(); };
    canvas.ondblclick = () => { view.range = null; view.changed(true); };
  }

  place(value) {
    return 58 + shareOf(value, ...this.ends, this.view.log) * (this.width - 70);
  }

  inverse(pixel) {
    const share = Math.min(1, Math.max(0, (pixel - 58) / (this.width - 70)));
    return valueAt(share, ...(this.ends || [0, 1]), this.view.log);
  }

  show(run, kept) {
    Object.assign(this, { run, kept });
    this.draw();
  }

  draw() {
    const { canvas, view, run, kept } = this, ratio = window.devicePixelRatio || 1;
    const width = (this.width = canvas.clientWidth), height = canvas.clientHeight;
    if (!run || !width) return;
    const size = [width, height].map((side) => Math.round(side * ratio));
    if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
    const g = canvas.getContext("2d", { willReadFrequently: true });
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    g.clearRect(0, 0, width, height);
    g.font = "12px system-ui, sans-serif";
    this.ends = view.range || view.ends || [run.time[0], run.time[run.time.length - 1]];
    if (!(this.ends[1] > this.ends[0])) this.ends = [this.ends[0], this.ends[0] + 1];
    const lines = [run, kept].filter(Boolean).map((one) =>
      this.curves.map((curve) => this.line(one.time, curve, curve.values(one))));
    let low = Math.min(...lines.flat().map((line) => line.low));
    let high = Math.max(...lines.flat().map((line) => line.high));
    if (!(high >= low)) [low, high] = [0, 1];
    if (run.fault) { // the last rows before a fault would hide all others
      const sizes = this.curves.flatMap((curve) => Array.from(curve.values(run), Math.abs));
      const most = 10 * sizes.sort((a, b) => a - b)[Math.floor(0.9 * sizes.length)] || 1;
      [low, high] = [Math.max(low, -most), Math.min(high, most)];
    }
    // A curve that is constant but for round-off is flat.
    const most = Math.max(Math.abs(low), Math.abs(high));
    if (high - low < (most * 1e-9 || 1)) [low, high] = [low - 0.1 * (most || 1), high + 0.1 * (most || 1)];
    const groups = lines.map((each) => equalLines(each, (high - low) / 400));
    const edge = 0.06 * (high - low), bottom = height - 34;
    [low, high] = [low - edge, high + edge];
    const y = (v) => 6 + ((high - v) / (high - low)) * (bottom - 6);
    this.grid(g, low, high, y, bottom);
    g.save();
    g.beginPath();
    g.rect(58, 2, width - 68, bottom);
    g.clip();
    groups.forEach((found, n) => found.forEach((group, k) => {
      // Early curves are wide: late ones that run close by do not cover them.
      g.lineWidth = (n ? 1.8 : 2.4) - (0.8 * k) / found.length;
      g.globalAlpha = n ? 0.55 : 1;
      const [{ points }] = group;
      stroke(g, group, () => {
        for (let i = 0; i < points.length; i += 2) g.lineTo(points[i], y(points[i + 1]));
      });
    }));
    g.restore();
    this.name(groups[0]);
    this.mark();
  }

  /** Write the legend, one entry for equal curves, if it is new. */
  name(groups) {
    const texts = groups.map((group) => group.map(({ curve }) => curve.label).join(" = "));
    if (this.names === (this.names = JSON.stringify(texts))) return;
    this.legend.textContent = "";
    this.readouts = groups.map((group, k) => {
      const item = element("span"), swatch = element("canvas"), value = element("b");
      const g = swatch.getContext("2d");
      [swatch.width, swatch.height] = [54, 16];
      g.scale(2, 2);
      g.lineWidth = 2;
      stroke(g, group, () => { g.moveTo(0, 4); g.lineTo(27, 4); });
      item.append(swatch, texts[k], value);
      this.legend.append(item);
      return [group[0].curve, value];
    });
  }

  /** Show cursor and values. */
  mark() {
    if (!this.ends) return;
    const { view, run, kept } = this, cursor = view.hover ?? view.cursor;
    this.cursor.hidden = cursor == null || cursor < this.ends[0] || cursor > this.ends[1];
    if (!this.cursor.hidden) this.cursor.style.left = `${this.place(cursor)}px`;
    for (const [curve, readout] of this.readouts) {
      const at = (one) => curve.values(one)[indexOf(one.time, cursor ?? Infinity)] * this.factor;
      const [now, before] = [run, kept].map((one) => one && quantity(at(one)));
      write(readout, before ? `${now} (${before})` : now);
    }
  }

  /** Return the points of a curve, at most a least and a largest one in each pixel, and its ends. */
  line(time, curve, values) {
    const points = [], [from, to] = this.ends;
    const first = Math.max(0, indexOf(time, from)), last = Math.min(time.length - 1, indexOf(time, to) + 1);
    let low = Infinity, high = -Infinity, pixel = NaN, least = 0, most = 0;
    const flush = () => {
      if (Number.isNaN(pixel)) return;
      for (const i of new Set([Math.min(least, most), Math.max(least, most)]))
        points.push(this.place(time[i]), values[i]);
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
    return { curve, values, first, last, points, low, high };
  }

  grid(g, low, high, y, bottom) {
    const { view, width, ends: [from, to] } = this, style = getComputedStyle(document.documentElement);
    const [factor, unit] = scaled(Math.max(Math.abs(low), Math.abs(high)), this.unit);
    this.factor = factor;
    g.strokeStyle = style.getPropertyValue("--line");
    g.fillStyle = style.getPropertyValue("--quiet");
    g.lineWidth = 1;
    g.beginPath();
    g.textAlign = "right";
    g.textBaseline = "middle";
    for (const tick of ticks(low * factor, high * factor, 6)) {
      const py = Math.round(y(tick / factor)) + 0.5;
      g.moveTo(58, py);
      g.lineTo(width - 12, py);
      g.fillText(signed(tick), 53, py);
    }
    g.textAlign = "center";
    g.textBaseline = "top";
    const decades = () => ticks(Math.log10(from), Math.log10(to), 7).filter(Number.isInteger);
    for (const tick of view.log ? decades().map((power) => 10 ** power) : ticks(from, to, 7)) {
      const px = Math.round(this.place(tick)) + 0.5;
      g.moveTo(px, 6);
      g.lineTo(px, bottom);
      g.fillText(signed(Number(tick.toPrecision(6))), px, bottom + 4);
    }
    g.stroke();
    g.fillText(`${view.label} [${view.unit}]`, 58 + (width - 70) / 2, bottom + 19);
    g.textAlign = "left";
    g.fillText(unit && `[${unit}]`, 62, 8);
  }
}
