"use strict";
// The worker of a served page: asks the server for runs and collects their rows.

class Engine {
  static of(message) {
    return Object.assign(new Engine(), message, { name: crypto.randomUUID(), running: null });
  }

  post(place, job, signal) {
    return fetch(this.address + place, { method: "POST", body: job.p, signal });
  }

  /** Return whether new values act on the run that goes on. */
  tune(job) {
    if (this.running?.steps !== job.steps || !this.data.pace) return false;
    this.post(`tune/${this.name}`, job).catch(() => {}); // the run itself shows a broken connection
    return true;
  }

  async run(job, pause) {
    const abort = new AbortController(), { tick, every } = this.data, parts = [];
    this.running = job;
    try {
      const reply = await this.post(`run/${this.name}/${(job.steps * tick[0]) / tick[1]}`, job, abort.signal);
      if (!reply.ok) throw Error(`the server answers ${reply.status} ${reply.statusText}`);
      const reader = reply.body.pipeThrough(new TextDecoderStream()).getReader();
      let rest = "", rows = 0;
      for (let part = await reader.read(); !part.done; part = await reader.read()) {
        const lines = (rest + part.value).split("\n");
        rest = lines.pop();
        for (const line of lines) {
          const { rows: packed, fault } = JSON.parse(line);
          parts.push(doubles(packed));
          if (fault !== undefined) return { ...this.result(parts), fault };
          rows += parts.at(-1).length / (this.data.width + 1);
        }
        if (rows && (await pause((rows * every) / job.steps, () => this.result(parts)))) return abort.abort();
      }
      throw Error("the server has ended");
    } finally {
      this.running = null;
    }
  }

  /** Return times and values of the rows in some parts. */
  result(parts) {
    const width = this.data.width + 1, count = parts.reduce((sum, part) => sum + part.length / width, 0);
    const time = new Float64Array(count), log = new Float64Array(count * (width - 1));
    let row = 0;
    for (const part of parts)
      for (let at = 0; at < part.length; at += width, ++row) {
        time[row] = part[at];
        log.set(part.subarray(at + 1, at + width), row * (width - 1));
      }
    return { time, log };
  }
}
