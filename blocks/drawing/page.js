const MARGIN = 48, HEAD = 44, FOOT = 10, RADIUS = 13; // around the content of an open group; of a junction [px]
const picture = document.getElementById("picture"), svg = picture.querySelector("svg");
const camera = svg.querySelector(".view").parentNode, keys = svg.querySelector(".keys");
const data = JSON.parse(document.getElementById("data").textContent);

const children = (element, selector) => [...element.children].filter((child) => child.matches(selector));
const numbers = (text) => text.trim().split(" ").map(Number);
const set = (element, values) => Object.entries(values).forEach(([name, value]) => element.setAttribute(name, value));
const drawn = (name, values) => {
  const element = document.createElementNS(svg.namespaceURI, name);
  set(element, values);
  return element;
};

// ---- groups: places with all of them closed, and what moves if some are open

function read(element, owner = null) {
  const [width, height] = numbers(element.dataset.size);
  const view = { element, owner, width, height };
  view.paths = children(element, ".signal").flatMap((signal) => children(signal, "path")).map((path) => [path, path.getAttribute("d")]);
  view.texts = children(element, "text").map((text) => [text, +text.getAttribute("x"), +text.getAttribute("y")]);
  view.blocks = children(element, ".block").map((group) => {
    const [x, y, w, h, row = null] = numbers(group.dataset.place);
    const block = { element: group, view, x, y, w, h, row, open: false, path: group.dataset.path };
    block.rects = children(group, "rect").map((rect) => [rect, ...["y", "width", "height"].map((name) => +rect.getAttribute(name))]);
    block.texts = children(group, "text").map((text) => [text, +text.getAttribute("y")]);
    const [inner] = children(group, ".view");
    if (inner) {
      block.inner = read(inner, block);
      block.leads = group.appendChild(drawn("g", {}));
      group.classList.add("group");
    }
    return block;
  });
  return view;
}

// Open groups push away the columns on their right and what is below. Returns the size of the view.
function arrange(view) {
  const cuts = { x: [], y: [] };
  const moved = (axis, value) => cuts[axis].reduce((sum, [at, by]) => (value > at ? sum + by : sum), value);
  const open = view.blocks.filter((block) => block.open);
  for (const block of open) {
    const [width, height] = arrange(block.inner);
    block.size = { x: width + 2 * MARGIN, y: height + HEAD + FOOT };
  }
  const column = (block) => view.blocks.filter((other) => other.x < block.x + block.w && block.x < other.x + other.w);
  // 1 px behind the blocks, as numbers in the picture are rounded.
  const ends = { x: (block) => 1 + Math.max(...column(block).map((other) => other.x + other.w)), y: (block) => 1 + block.y + block.h };
  for (const axis of ["x", "y"]) {
    for (const block of open.sort((a, b) => ends[axis](a) - ends[axis](b))) {
      const end = ends[axis](block);
      const missing = block.size[axis] - moved(axis, end + 0.01) + moved(axis, block[axis]);
      if (missing > 0) cuts[axis].push([end, missing]);
    }
  }
  view.blocks.forEach((block) => place(block, moved));
  for (const [path, d] of view.paths) {
    set(path, { d: d.split("M").slice(1).map((part) => `M${pulled(part.split("L"), moved).join("L")}${part.endsWith("h0") ? "h0" : ""}`).join("") });
  }
  for (const [text, x, y] of view.texts) set(text, { x: moved("x", x), y: moved("y", y) });
  return [moved("x", view.width + 1), moved("y", view.height + 1)];
}

// The points of a wire; an end at the top or bottom of a circle moves with its middle.
function pulled(points, moved) {
  const places = points.map((point) => point.split(" ").map(parseFloat)), [[x, y], [before, from] = []] = places.slice(-2).reverse();
  const side = before === x ? RADIUS * Math.sign(from - y) : 0;
  return places.map(([left, top], i) => {
    const by = i === places.length - 1 ? side : 0;
    return `${moved("x", left)} ${moved("y", top - by) + by}`;
  });
}

function place(block, moved) {
  const { element, row, open } = block;
  const left = moved("x", block.x), top = row === null ? moved("y", block.y) : moved("y", block.y + row) - row;
  const inside = (y) => (row === null ? moved("y", block.y + y) - top : y);
  set(element, { transform: `translate(${left},${top})` });
  for (const [text, y] of block.texts) set(text, { y: open && text.classList.contains("name") ? 17 : inside(y) });
  for (const [rect, y, width, height] of block.rects) {
    set(rect, { y: inside(y), width, height: inside(y + height) - inside(y) });
    if (open) set(rect, { width: block.size.x - block.w + width, height: block.size.y - block.h + height });
  }
  if (!block.inner) return;
  element.classList.toggle("open", open);
  set(block.inner.element, { transform: `translate(${MARGIN},${HEAD})` });
  block.leads.replaceChildren();
  if (!open) return;
  for (const [port] of block.inner.texts) {
    const outside = block.texts.find(([text]) => text.dataset.port && text.dataset.port === port.dataset.port);
    if (!outside) continue;
    const { x, width } = port.getBBox(), input = port.classList.contains("end");
    const [start, stop] = input ? [0, MARGIN + x - 4] : [block.size.x, MARGIN + x + width + 4];
    const from = inside(outside[1]), to = HEAD + +port.getAttribute("y"), middle = (start + stop) / 2;
    block.leads.append(drawn("path", { class: "lead", d: `M${start} ${from}C${middle} ${from} ${middle} ${to} ${stop} ${to}` }));
  }
}

const whole = read(svg.querySelector(".view"));
const all = (view) => view.blocks.flatMap((block) => [block, ...(block.inner ? all(block.inner) : [])]);
const blocks = all(whole);

// ---- camera

const eye = { x: 0, y: 0, scale: 1 };

function look(x, y, scale) {
  Object.assign(eye, { x, y, scale: Math.min(8, Math.max(0.05, scale)) });
  set(camera, { transform: `translate(${eye.x},${eye.y}) scale(${eye.scale})` });
}

function fit() {
  const { width, height } = picture.getBoundingClientRect(), [w, h] = arrange(whole);
  const scale = Math.min((width - 24) / w, (height - 56) / h, 1.6);
  look((width - scale * w) / 2, Math.max(12, (height - 32 - scale * h) / 2), scale);
  set(keys, { transform: `translate(0,${height - 22})` });
}

function zoom(x, y, factor) {
  const scale = Math.min(8, Math.max(0.05, eye.scale * factor)), by = scale / eye.scale;
  look(x - (x - eye.x) * by, y - (y - eye.y) * by, scale);
}

function goTo(block) {
  for (let owner = block.view.owner; owner; owner = owner.view.owner) owner.open = true;
  fit();
  const frame = picture.getBoundingClientRect(), box = block.element.getBoundingClientRect();
  const scale = Math.max(eye.scale, 1), by = scale / eye.scale;
  const x = box.x + box.width / 2 - frame.x, y = box.y + box.height / 2 - frame.y;
  look(frame.width / 2 - (x - eye.x) * by, frame.height / 2 - (y - eye.y) * by, scale);
}

picture.addEventListener("wheel", (event) => {
  event.preventDefault();
  const { x, y } = picture.getBoundingClientRect();
  zoom(event.clientX - x, event.clientY - y, Math.exp(-event.deltaY / 500));
}, { passive: false });

let start = null, dragged = false;
picture.addEventListener("pointerdown", (event) => {
  start = { x: event.clientX - eye.x, y: event.clientY - eye.y, at: [event.clientX, event.clientY] };
  dragged = false;
});
window.addEventListener("pointermove", (event) => {
  if (!start) return;
  dragged ||= Math.hypot(event.clientX - start.at[0], event.clientY - start.at[1]) > 4;
  if (dragged) look(event.clientX - start.x, event.clientY - start.y, eye.scale);
});
window.addEventListener("pointerup", () => { start = null; });

picture.addEventListener("click", (event) => {
  if (dragged) return;
  const signal = event.target.closest(".signal.plotted");
  const block = blocks.find((one) => one.inner && one.element === event.target.closest(".block"));
  if (signal) plot(signal.dataset.path);
  else if (block) {
    block.open = !block.open;
    arrange(whole);
  }
});

function openAll(open) {
  blocks.forEach((block) => { block.open = open && Boolean(block.inner); });
  fit();
}
const actions = { open: () => openAll(true), close: () => openAll(false), fit };
for (const [id, action] of Object.entries(actions)) document.getElementById(id).addEventListener("click", action);
for (const id of ["open", "close"]) document.getElementById(id).hidden = !blocks.some((block) => block.inner);

// ---- search

const search = document.getElementById("search"), hits = document.getElementById("hits");
let found = [], current = -1;
search.addEventListener("input", () => {
  const text = search.value.trim().toLowerCase();
  found = text ? blocks.filter((block) => block.path.toLowerCase().includes(text)) : [];
  current = -1;
  blocks.forEach((block) => block.element.classList.toggle("hit", found.includes(block)));
  hits.textContent = text ? `${found.length} found` : "";
});
search.addEventListener("keydown", (event) => {
  if (event.key !== "Enter" || !found.length) return;
  current = (current + 1) % found.length;
  hits.textContent = `${current + 1} of ${found.length}: ${found[current].path}`;
  goTo(found[current]);
});

// ---- chart of a signal

const panel = document.getElementById("chart"), close = panel.querySelector("button");
const time = { label: "time", unit: "s", range: null, changed: () => chart.show(data) };
let chart = null;
for (const signal of svg.querySelectorAll(".signal")) signal.classList.toggle("plotted", signal.dataset.path in data.signals);

function plot(path) {
  panel.hidden = path === null;
  for (const signal of svg.querySelectorAll(".signal")) signal.classList.toggle("shown", signal.dataset.path === path);
  if (panel.hidden) return;
  const { unit, lines } = data.signals[path];
  panel.replaceChildren(close);
  chart = new Chart(panel, { title: path, unit, curves: lines.map((line, i) => ({ label: lines.length > 1 ? `[${i}]` : "", values: () => line })) }, time);
  time.changed();
}
close.addEventListener("click", () => plot(null));
window.addEventListener("resize", () => { fit(); if (!panel.hidden) time.changed(); });

svg.removeAttribute("viewBox");
fit();
document.body.dataset.state = "ready";
