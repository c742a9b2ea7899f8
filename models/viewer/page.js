// The page of a run: the picture in space, and charts on the same axis of time.

class Page {
  constructor(head) {
    Object.assign(this, head, { charts: [], start: head.time[0], end: head.time.at(-1) });
    this.t = this.start;
    const changed = (all) => this.charts.forEach((chart) => (all ? chart.draw() : chart.mark()));
    const ends = [this.start, this.end], pick = (t) => this.show(t);
    this.view = { label: "time", unit: "s", ends, pick, changed };
    const instants = Array.from({ length: 21 }, (_, k) => this.start + ((this.end - this.start) * k) / 20);
    const cloud = instants.map((t) => Scene3d.posed(this.truss, this.state(t)));
    const target = this.target && Scene3d.stateOf(this.ends, this.target);
    const options = { target, longest: this.longest, cloud };
    this.scene = new Scene3d.Scene($("picture"), this.truss, this.state(this.t), options);
  }

  get scale() { return Number($("exaggeration").value); }

  state(t) {
    const i = indexOf(this.time, t + 1e-9), { ends, coordinates, force = [], torque = [] } = this;
    return Scene3d.stateOf(ends, ...[coordinates, force, torque].map((rows) => rows.map((row) => row[i])));
  }

  legend() {
    $("legend").replaceChildren(...this.scene.legend().map(([name, colour]) => {
      const entry = element("button", "entry", name), mark = element("i");
      entry.title = "show or hide";
      mark.style.background = colour;
      entry.prepend(mark);
      entry.onclick = () => { this.scene.toggle(name); entry.classList.toggle("off"); };
      return entry;
    }));
  }

  show(t) {
    this.t = Math.min(this.end, Math.max(this.start, t));
    $("time").value = this.t;
    $("now").textContent = `${this.t.toFixed(2)} s`;
    $("scale").textContent = `deformation × ${this.scale}`;
    this.scene.show(this.state(this.t), this.scale);
    this.view.cursor = this.t;
    this.view.changed();
  }

  // Frames of a film as data URLs, one a line, for a program that reads the page.
  film(count, width, height) {
    const found = element("pre");
    document.body.append(found);
    for (let k = 0; k < count; k++) {
      this.t = this.start + ((this.end - this.start) * k) / (count - 1);
      this.scene.show(this.state(this.t), this.scale);
      found.append(`${this.scene.picture(width, height)}\n`);
    }
  }

  chart(name) { // of a signal that the reader may change
    const select = element("select"), place = element("div"), number = this.charts.length;
    select.ariaLabel = "signal";
    select.append(...this.signals.map(({ name, units }) =>
      new Option(name.replaceAll("_", " ") + (units && ` [${units}]`), name)));
    select.value = name;
    $("charts").append(select, place);
    select.onchange = () => {
      const { units, inner, components, values } = this.signals[select.selectedIndex];
      const colour = (k) => COLOURS[Math.floor(k / inner) % COLOURS.length];
      const curves = components.map((label, k) => ({ label, colour: colour(k), values: () => values[k] }));
      place.textContent = "";
      this.charts[number] = new Chart(place, { unit: units, curves }, this.view);
      this.charts[number].show(this);
    };
    select.onchange();
  }
}

// ---- its controls

function listen(page) {
  player($("play"), (passed) => {
    page.show(page.t >= page.end ? page.start : page.t + passed * Number($("speed").value));
    return page.t < page.end;
  });
  $("time").oninput = () => page.show(Number($("time").value));
  $("exaggeration").oninput = () => page.show(page.t);
  $("camera").onchange = $("follow").onchange = () => page.scene.look($("camera").value, $("follow").value);
}

async function begin() {
  const asked = new URLSearchParams(location.hash.slice(1));
  const head = JSON.parse(new TextDecoder().decode(await inflated("head")), unpacked);
  if (asked.has("still")) { // a picture of so many pixels height, and nothing else
    document.body.className = "still";
    $("left").style.height = `${asked.get("still")}px`;
  }
  $("camera").value = asked.get("camera") ?? "oblique";
  $("exaggeration").value = asked.get("exaggeration") ?? head.exaggeration;
  const page = new Page(head), t = Number(asked.get("t") ?? page.start);
  if (!(page.start - 1e-6 <= t && t <= page.end + 1e-6))
    throw new Error(`there is no t = ${asked.get("t")} s, the run is from ${page.start} to ${page.end} s`);
  page.t = t;
  $("follow").value = asked.get("follow") ?? (page.scene.lost ? "truss" : "nothing");
  page.scene.look($("camera").value, $("follow").value);
  // The arrow keys move the slider by one instant of the picture.
  const step = (page.end - page.start) / (page.time.length - 1);
  Object.assign($("time"), { min: page.start, max: page.end, step });
  page.legend();
  if (asked.has("film")) page.film(...asked.get("film").split(",").map(Number));
  else if (!asked.has("still")) page.charted.forEach((name) => page.chart(name));
  listen(page);
  page.show(page.t);
  window.page = page;
  document.body.dataset.state = "ready";
  console.info("This page is shown");
}

begin().catch((error) => {
  $("trouble").textContent = `This page cannot be shown: ${error.message}`;
  console.info($("trouble").textContent);
  throw error;
});
