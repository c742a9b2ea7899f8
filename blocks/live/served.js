"use strict";
// The worker of a served page: asks the server for runs and collects their rows.

const doubles = (text) => new Float64Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);

class Engine {
  static of(message) {
    return Object.assign(new Engine(), message, { name: crypto.randomUUID(), running: null });
  }

  post(place, job, signal) {
    return fetch(this.address + place, { method: "POST", body: job.p, signal });
  }

  /** Return whether new values act on the run that goes on. */
  tune(job) {
    if (!this.running || !this.data.pace) return false;
    this.post(`tune/${this.name}`, job).catch(() => {}); // the run itself shows a broken connection
    return true;
  }

  async run(job, pause) {
    const { every, steps } = this.data, width = this.data.width + 1, values = [];
    const abort = new AbortController();
    const result = () => ({ // times, and rows without them
      time: Float64Array.from({ length: values.length / width }, (_, row) => values[row * width]),
      log: Float64Array.from(values.filter((_, i) => i % width)),
    });
    this.running = job;
    try {
      const reply = await this.post(`run/${this.name}`, job, abort.signal);
      if (!reply.ok) throw Error(`the server answers ${reply.status} ${reply.statusText}`);
      const reader = reply.body.pipeThrough(new TextDecoderStream()).getReader();
      let rest = "";
      for (let part = await reader.read(); !part.done; part = await reader.read()) {
        const lines = (rest + part.value).split("\n");
        rest = lines.pop();
        for (const line of lines) {
          if (line[0] === "{") return { ...result(), ...JSON.parse(line) };
          values.push(...doubles(line));
        }
        const share = (values.length / width / steps) * every;
        if (share && (await pause(share, result))) return abort.abort();
      }
      throw Error("the server has ended");
    } finally {
      this.running = null;
    }
  }
}
