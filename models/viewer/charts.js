// Charts over time on a canvas without a library: SI prefixes, equal curves told apart, legend below the axes.
"use strict";

const Charts = (() => {
  const PREFIXES = { "-12": "p", "-9": "n", "-6": "µ", "-3": "m", 3: "k", 6: "M", 9: "G", 12: "T" };
  const PREFIXED = /^(m|s|N|rad|J|W|Pa|Hz|V|A)(?![A-Za-z^²³⁴0-9])/; // the unit at the start may have a prefix
  const ONLY_SMALL = /^(s|rad)/;
  const DASHES = [[], [7, 3], [2, 2.5], [8, 3, 2, 3]]; // of curves that have one colour
  const SPACE = { left: 52, right: 10, top: 18, bottom: 32 }; // around the axes [px]
  const PIECE = 9; // of each curve in a line that several curves share [px]

  // Power of ten and unit in which numbers up to `largest` have one to four digits before the point.
  function scaled(units, largest) {
    if (!(largest > 0) || (largest >= 0.1 && largest < 1e4)) return { power: 0, units };
    const power = 3 * Math.floor(Math.log10(largest) / 3 + 1e-9);
    const fits = PREFIXED.test(units) && !units.includes(",") && !(power > 0 && ONLY_SMALL.test(units));
    if (PREFIXES[power] && fits) return { power, units: PREFIXES[power] + units };
    const raised = [...String(power)].map((c) => (c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[c])).join("");
    return { power, units: `10${raised} ${units}`.trim() };
  }

  function ticksOf(low, high, count) { // multiples of 1, 2 or 5 times a power of ten
    const rough = (high - low) / count, unit = 10 ** Math.floor(Math.log10(rough));
    const step = unit * [1, 2, 5, 10].find((k) => k * unit >= rough * 0.999), found = [];
    const first = Math.ceil(low / step - 1e-9), digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    for (let k = first; k * step <= high + 1e-9 * step && found.length < 30; k++)
      found.push([k * step, (k * step).toFixed(Math.min(digits, 12)).replace("-", "−")]);
    return found;
  }

  // Lists of curves that lie on each other within `tolerance`; curves of different alpha belong to different runs.
  function equalGroups(curves, tolerance) {
    const groups = [];
    for (const curve of curves) {
      const equal = ([one]) => one.alpha === curve.alpha && one.y.every((a, k) => !(Math.abs(a - curve.y[k]) > tolerance));
      const group = groups.find(equal);
      if (group) group.push(curve);
      else groups.push([curve]);
    }
    return groups;
  }

  function placed(x, value) { // index of the last element that is not greater
    let low = 0, high = x.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (x[middle] <= value) low = middle;
      else high = middle - 1;
    }
    return low;
  }

  const add = (parent, kind, className, textContent = "") =>
    parent.appendChild(Object.assign(document.createElement(kind), { className, textContent }));

  class Chart {
    // `seek(t)` is called for a click, `zoomed([from, to])` for a dragged part of the axis, or null for all of it.
    constructor(place, { seek, zoomed }) {
      Object.assign(this, { place, seek, zoomed, curves: [], groups: [], range: [0, 1], t: 0 });
      this.axes = add(place, "div", "axes");
      this.canvas = add(this.axes, "canvas", "");
      this.cursor = add(this.axes, "div", "cursor");
      this.band = add(this.axes, "div", "band");
      this.values = add(this.axes, "div", "values");
      this.legend = add(place, "div", "legend");
      this.band.hidden = this.values.hidden = true;
      this.listen();
      new ResizeObserver(() => this.draw()).observe(this.axes);
    }

    // Curves have a name, x, y, colour and alpha.
    show(curves, units, range) {
      let [low, high] = [Infinity, -Infinity];
      for (const { y } of curves)
        for (const value of y) if (Number.isFinite(value)) [low, high] = [Math.min(low, value), Math.max(high, value)];
      Object.assign(this, { curves, range, ...scaled(units, Math.max(high, -low)) });
      this.groups = equalGroups(curves, (high - low) / 400);
      this.groups.forEach((group, k) => { // early curves are wide: late ones that run close by do not cover them
        const before = this.groups.slice(0, k).filter(([one, ...more]) => !more.length && one.colour === group[0].colour);
        Object.assign(group, { dash: DASHES[before.length % DASHES.length], width: 2.6 - (1.4 * k) / this.groups.length });
      });
      this.legend.textContent = "";
      if (curves.length > 1)
        for (const group of this.groups.filter(([one]) => one.alpha === curves[0].alpha)) {
          const entry = add(this.legend, "span", "entry"), swatch = add(entry, "canvas", "");
          [swatch.width, swatch.height] = [72, 16];
          this.stroke(swatch.getContext("2d"), group, 2, (context) => { context.moveTo(0, 4); context.lineTo(36, 4); });
          add(entry, "span", "", group.map(({ name }) => name).join(" = "));
        }
      this.draw();
    }

    stroke(context, group, density, path) { // curves that share a line alternate along it
      group.forEach(({ colour, alpha }, k) => {
        context.setTransform(density, 0, 0, density, 0, 0);
        const style = { strokeStyle: colour, globalAlpha: alpha, lineWidth: group.width, lineDashOffset: -k * PIECE };
        Object.assign(context, style);
        context.setLineDash(group.length > 1 ? [PIECE, PIECE * (group.length - 1)] : group.dash);
        context.beginPath();
        path(context);
        context.stroke();
      });
      context.setLineDash([]);
      context.globalAlpha = 1;
    }

    zoom(range) {
      this.range = range;
      this.draw();
    }

    at(t) { return SPACE.left + ((t - this.range[0]) / (this.range[1] - this.range[0])) * this.wide; }

    time(x) { return this.range[0] + ((x - SPACE.left) / this.wide) * (this.range[1] - this.range[0]); }

    mark(t = this.t) { // the shown instant
      this.t = t;
      this.cursor.hidden = t < this.range[0] || t > this.range[1];
      this.cursor.style.left = `${this.at(t)}px`;
    }

    limits() { // of the values in the visible range of time
      let low = Infinity, high = -Infinity;
      for (const { x, y } of this.curves)
        for (let k = placed(x, this.range[0]); k < x.length && x[k] <= this.range[1]; k++)
          if (Number.isFinite(y[k])) [low, high] = [Math.min(low, y[k]), Math.max(high, y[k])];
      if (!(low < high)) { // a constant
        const half = Math.abs(low);
        [low, high] = half > 0 && half < Infinity ? [low - half, low + half] : [-1, 1];
      }
      const margin = 0.06 * (high - low);
      return [low - margin, high + margin];
    }

    draw() {
      const { canvas, axes } = this, density = devicePixelRatio, [width, height] = [axes.clientWidth, axes.clientHeight];
      if (!width || !this.units && this.units !== "") return;
      [canvas.width, canvas.height] = [Math.round(width * density), Math.round(height * density)];
      const context = canvas.getContext("2d"), colour = getComputedStyle(this.place).color, unit = 10 ** this.power;
      this.wide = width - SPACE.left - SPACE.right;
      const tall = height - SPACE.top - SPACE.bottom, bottom = SPACE.top + tall, [low, high] = this.limits();
      const up = (value) => bottom - ((value - low) / (high - low)) * tall;
      this.up = up;
      context.setTransform(density, 0, 0, density, 0, 0);
      Object.assign(context, { fillStyle: colour, strokeStyle: colour, font: "11px system-ui, sans-serif" });
      const line = (x, y, X, Y) => { context.beginPath(); context.moveTo(x, y); context.lineTo(X, Y); context.stroke(); };
      context.globalAlpha = 0.16;
      const across = ticksOf(...this.range, Math.max(2, this.wide / 60)), along = ticksOf(low / unit, high / unit, 6);
      for (const [t] of across) line(this.at(t), SPACE.top, this.at(t), bottom);
      for (const [value] of along) line(SPACE.left, up(value * unit), width - SPACE.right, up(value * unit));
      context.globalAlpha = 1;
      context.textAlign = "center";
      for (const [t, text] of across) context.fillText(text, this.at(t), bottom + 13);
      context.fillText("time [s]", SPACE.left + this.wide / 2, height - 5);
      context.textAlign = "right";
      for (const [value, text] of along) context.fillText(text, SPACE.left - 6, up(value * unit) + 4);
      context.textAlign = "left";
      context.fillText(this.units ? `[${this.units}]` : "", 4, 11);
      context.save();
      context.beginPath();
      context.rect(SPACE.left, SPACE.top - 2, this.wide, tall + 4);
      context.clip();
      for (const group of this.groups)
        this.stroke(context, group, density, () => {
          const { x, y } = group[0], end = Math.min(x.length - 1, placed(x, this.range[1]) + 1);
          for (let k = placed(x, this.range[0]); k <= end; k++) context.lineTo(this.at(x[k]), up(y[k]));
        });
      context.restore();
      this.mark();
    }

    listen() {
      let from = null;
      const inside = (event) => Math.min(SPACE.left + this.wide, Math.max(SPACE.left, event.offsetX));
      const { canvas, band, values } = this;
      canvas.addEventListener("pointerdown", (event) => {
        from = inside(event);
        canvas.setPointerCapture(event.pointerId);
      });
      canvas.addEventListener("pointermove", (event) => {
        const x = inside(event);
        this.read(x, event.offsetY);
        band.hidden = from === null || Math.abs(x - from) < 5;
        if (from !== null) Object.assign(band.style, { left: `${Math.min(x, from)}px`, width: `${Math.abs(x - from)}px` });
      });
      canvas.addEventListener("pointerup", (event) => {
        const ends = [from ?? inside(event), inside(event)].sort((a, b) => a - b).map((x) => this.time(x));
        const dragged = !band.hidden;
        from = null;
        band.hidden = true;
        if (dragged) this.zoomed(ends);
        else this.seek(ends[0]);
      });
      canvas.addEventListener("dblclick", () => this.zoomed(null));
      canvas.addEventListener("pointerleave", () => { values.hidden = true; });
    }

    read(left, top) { // the values nearest to the pointer
      const t = this.time(left), unit = 10 ** this.power;
      const near = this.curves.map((curve) => ({ curve, value: curve.y[placed(curve.x, t)] }));
      near.sort((a, b) => Math.abs(this.up(a.value) - top) - Math.abs(this.up(b.value) - top));
      this.values.textContent = `${Number(t.toPrecision(4))} s`;
      for (const { curve, value } of near.slice(0, 6)) {
        const text = `${curve.name} ${Number((value / unit).toPrecision(4))} ${this.units}`;
        add(this.values, "div", "", text).style.color = curve.colour;
      }
      this.values.hidden = !this.curves.length;
      this.values.style.left = `${left > this.axes.clientWidth / 2 ? left - this.values.offsetWidth - 8 : left + 8}px`;
    }
  }

  return { Chart, scaled };
})();
