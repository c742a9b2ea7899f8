// The queue of a worker: the latest values wait until the present run ends, or end it.

const QUIET = 100; // ms between reports of a long run
const PATIENCE = 1500; // ms after which a run ends for newer values

let engine = null, wanted = null, busy = false;
const rest = (time) => new Promise((resolve) => setTimeout(resolve, time));

async function serve(job) {
  const begin = performance.now();
  let reported = begin;
  const pause = async (share, result) => {
    const now = performance.now();
    if (now - reported < QUIET) return false;
    postMessage({ id: job.id, progress: share, ...result(), fault: "" });
    reported = now;
    await rest(0);
    return wanted && now - begin > PATIENCE;
  };
  const result = await engine.run(job, pause);
  if (!result) return;
  const seconds = (performance.now() - begin) / 1000;
  postMessage({ id: job.id, ...result, seconds }, [result.time.buffer, result.log.buffer]);
  if (engine.data.loop) await rest(0);
  if (!engine.data.loop || wanted) return;
  postMessage({ id: job.id, analysis: analysed(engine.linear(...engine.points[job.point])) });
}

onmessage = async ({ data: message }) => {
  try {
    if (message.data) engine = await Engine.of(message);
    else if (wanted || !engine?.tune?.(message)) wanted = message;
    if (!engine || busy) return;
    busy = true;
    for (let job = wanted; job; job = wanted) {
      wanted = null;
      await serve(job);
    }
  } catch (error) {
    postMessage({ error: error.message });
  }
  busy = false;
};
