"use strict";
// The worker of a served page: asks the server for runs and collects their rows.

const QUIET = 100; // ms between reports of a long run
const PATIENCE = 1500; // ms after which a run ends for newer values

let data = null, address = "", wanted = null, running = null;
const name = crypto.randomUUID();

const post = (action, query, job, signal) =>
  fetch(`${address}${action}?${new URLSearchParams({ run: name, ...query })}`, { method: "POST", body: job.p, signal });

/** Yield the lines of a stream of text. */
async function* lines(stream) {
  const reader = stream.pipeThrough(new TextDecoderStream()).getReader();
  let rest = "";
  for (let part = await reader.read(); !part.done; part = await reader.read()) {
    const parts = (rest + part.value).split("\n");
    rest = parts.pop();
    yield* parts;
  }
}

/** Return times and values of rows in packed form. */
function unpacked(packed) {
  const width = data.width + 1, rows = new Float64Array(packed.length / 8);
  new Uint8Array(rows.buffer).set(packed);
  const count = rows.length / width, time = new Float64Array(count), log = new Float64Array(count * data.width);
  for (let i = 0; i < count; i++) {
    time[i] = rows[i * width];
    log.set(rows.subarray(i * width + 1, (i + 1) * width), i * data.width);
  }
  return { time, log };
}

async function run(job) {
  const begin = performance.now(), seconds = data.tick[0] / data.tick[1], abort = new AbortController();
  const older = () => wanted && !data.pace && performance.now() - begin > PATIENCE && abort.abort();
  running = { older };
  const reply = await post("run", { duration: job.steps * seconds }, job, abort.signal);
  if (!reply.ok) throw new Error(`the server answers ${reply.status} ${reply.statusText}`);
  let packed = new Uint8Array(1 << 16), size = 0, reported = begin, fault = null;
  for await (const line of lines(reply.body)) {
    const part = JSON.parse(line), bytes = Uint8Array.from(atob(part.rows), (c) => c.charCodeAt(0));
    while (size + bytes.length > packed.length) {
      const more = new Uint8Array(2 * packed.length);
      more.set(packed.subarray(0, size));
      packed = more;
    }
    packed.set(bytes, size);
    size += bytes.length;
    fault = part.fault ?? null;
    older();
    if (fault === null && size && performance.now() - reported > QUIET) {
      const rows = unpacked(packed.subarray(0, size));
      postMessage({ id: job.id, progress: rows.time.length * data.every / job.steps, ...rows, fault: "" });
      reported = performance.now();
    }
  }
  if (fault === null) throw new Error("the server has ended");
  postMessage({ id: job.id, ...unpacked(packed.subarray(0, size)), fault, seconds: (performance.now() - begin) / 1000 });
}

async function drain() {
  while (wanted) {
    const job = wanted;
    wanted = null;
    try {
      await run(job);
    } catch (error) {
      if (error.name !== "AbortError") postMessage({ id: job.id, error: String(error.message) });
    }
    running = null;
  }
}

onmessage = ({ data: message }) => {
  if (message.data) [data, address] = [message.data, message.address];
  else if (running && data.pace) post("tune", {}, message); // the run goes on with the new values
  else {
    wanted = message;
    running?.older();
  }
  if (data && !running && wanted) drain();
};
