// The worker of a live page: runs the compiled equations, so that the page never waits for them.

const CHUNKS = 200; // of a run, between which new values are seen

class Engine {
  static async of({ data, module }) {
    const size = 2 * (data.steps + 1), compiled = await WebAssembly.compile(module.subarray(size));
    const { exports } = await WebAssembly.instantiate(compiled, {});
    return new Engine(data, module.subarray(0, size), exports);
  }

  constructor(data, due, exports) {
    this.data = data;
    this.c = exports;
    if (exports._initialize) exports._initialize();
    this.top = exports.__heap_base.value;
    const [p, x, d] = data.sizes;
    this.program = Object.fromEntries(data.programs.map((name, number) => [name, number]));
    this.work = this.take(Number(exports.tf_work_size()));
    this.p = this.take(8 * p);
    this.x = this.take(8 * x);
    this.d = this.take(8 * d);
    this.after = this.take(8 * (x + d));
    this.bad = this.take(8 * (1 + Math.max(p, x, d)));
    this.fault = this.take(4);
    this.kinds = this.take(data.kinds.length);
    new Int8Array(exports.memory.buffer, this.kinds).set(data.kinds);
    this.start = data.numbers.subarray(p);
    if (data.loop) {
      this.opened = data.loop.values;
      this.point = this.take(8 * (this.opened.length + x + 1));
      this.wire = this.take(8 * Math.max(x + 1, data.loop.size));
    }
    const { every, steps, width } = data;
    this.rows = Math.ceil(steps / every) + 1;
    this.due = this.take(2 * (steps + 1));
    this.logged = this.take(steps + 1);
    this.log = this.take(8 * width * (this.rows + 1));
    new Uint8Array(exports.memory.buffer, this.due).set(due);
    for (let k = 0; k <= steps; k += every) new Uint8Array(exports.memory.buffer, this.logged)[k] = 1;
  }

  /** Return the rows of [A, B; C, D] of the loop at a point (time, x, d), for negative feedback. */
  linear(time, x, d) {
    const { sizes: [, n], loop } = this.data, size = this.opened.length;
    this.array(this.x, n).set(x);
    this.array(this.d, d.length).set(d);
    this.evaluate("wire", time, this.x, this.d, this.wire);
    const wire = this.array(this.wire, loop.element + 1)[loop.element];
    const values = this.array(this.point, size + n + 1), direction = values.subarray(size);
    values.set(this.opened);
    values.set(d.subarray(0, loop.kept));
    values[loop.sent] = wire;
    const rows = Array.from({ length: n + 1 }, () => []);
    for (let k = 0; k <= n; ++k) {
      direction.fill(0);
      direction[k] = 1;
      this.evaluate("slope", time, this.x, this.point, this.wire);
      const slope = this.array(this.wire, n + 1);
      if (!slope.every(Number.isFinite)) throw Error(`the loop at '${loop.name}' has no finite derivative`);
      rows.forEach((row, i) => { row[k] = i < n ? slope[i] : -slope[n]; });
    }
    return rows;
  }

  /** Return the address of new memory. */
  take(size) {
    const address = Math.ceil(this.top / 64) * 64, memory = this.c.memory;
    this.top = address + size;
    const missing = this.top + 64 - memory.buffer.byteLength;
    if (missing > 0) memory.grow(Math.ceil(missing / 65536));
    return address;
  }

  array(address, size) {
    return new Float64Array(this.c.memory.buffer, address, size);
  }

  evaluate(name, time, x, d, result) {
    this.c.tf_evaluate(this.program[name], time, x, d, this.p, result);
  }

  /** Run from the initial states; `pause` is awaited between slices and ends the run if it returns true. */
  async run(job, pause) {
    const { sizes: [np, nx, nd], tick: [over, under], method, width, stored, modes, sides } = this.data;
    const { every, steps } = this.data;
    this.array(this.p, np).set(job.p);
    this.array(this.x, nx).set(this.start.subarray(0, nx));
    this.array(this.d, nd).set(this.start.subarray(nx));
    this.evaluate("initialization", 0, this.x, this.d, this.after);
    this.array(this.x, nx).set(this.array(this.after, nx));
    this.array(this.d, nd).set(this.array(this.after, nx + stored).subarray(nx));
    const begin = [0, this.array(this.x, nx).slice(), this.array(this.d, nd).slice()];
    let row = 0, k = 0, fault = "";
    while (k < steps && !fault) {
      const number = Math.min(Math.ceil(steps / CHUNKS), steps - k);
      k += Number(this.c.tf_advance(this.work, method, over, under, BigInt(k), BigInt(number),
        this.x, this.d, this.p, this.due + 2 * k, this.logged + k, this.log + 8 * width * row, BigInt(width),
        this.fault, this.bad, this.kinds, sides, 0, 0, 0));
      const code = new Int32Array(this.c.memory.buffer, this.fault, 1)[0];
      row = Math.ceil((k + (code && code !== 2)) / every);
      if (code) fault = this.explain(code, (k * over) / under, ((k + 1) * over) / under);
      if (k < steps && (await pause(k / steps, () => this.result(row)))) return null;
    }
    const end = (k * over) / under, due = new Uint16Array(this.c.memory.buffer, this.due, steps + 1)[k];
    if (!fault && due) {
      this.evaluate(`sample_${due}`, end, this.x, this.d, this.after);
      const d = this.array(this.after, nd);
      if (d.subarray(modes).every(Number.isFinite)) this.array(this.d, nd).set(d);
      else fault = `${this.named(1, d, modes)} stopped being finite at t = ${end} s`;
    }
    if (!fault) this.evaluate("outputs", end, this.x, this.d, this.log + 8 * width * row++);
    const result = this.result(row);
    if (!fault) result.time[row - 1] = end;
    const last = [end, this.array(this.x, nx).slice(), this.array(this.d, nd).slice()];
    this.points = { start: begin, end: fault ? begin : last };
    return { ...result, fault };
  }

  /** Return times and values of the first rows. */
  result(rows) {
    const { tick: [over, under], width, every } = this.data;
    const time = Float64Array.from({ length: rows }, (_, i) => (i * every * over) / under);
    return { time, log: this.array(this.log, width * rows).slice() };
  }

  /** Return the name of the first element that is not finite. */
  named(which, values, first = 0) {
    const i = values.findIndex((v, k) => k >= first && !Number.isFinite(v));
    const place = this.data.places[which].find(([, start, stop]) => start <= i && i < stop);
    return place ? `'${place[0]}'${place[2] - place[1] > 1 ? ` (element ${i - place[1]})` : ""}` : "a value";
  }

  explain(code, time, after) {
    const bad = this.array(this.bad, Math.max(...this.data.sizes) + 1), [, nx, nd] = this.data.sizes;
    const at = (t) => `at t = ${Number(t.toPrecision(6))} s`;
    return {
      1: `${this.named(0, bad.subarray(0, nx))} stopped being finite ${at(after)}`,
      2: `${this.named(1, bad.subarray(0, nd), this.data.modes)} stopped being finite ${at(time)}`,
      3: `an event indicator is not a number ${at(time)}`,
      4: `events follow each other without end ${at(bad[0])}`,
      7: `a block ended the run ${at(bad[0])}`,
      8: `a delay has no room for more points ${at(bad[0])}`,
    }[code] ?? `an algebraic loop has no solution ${at(bad[0])}`;
  }
}
