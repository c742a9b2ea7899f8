const svg = document.querySelector("#picture svg"), search = $("search"), panel = $("chart");
const data = JSON.parse($("data").textContent, unpacked), groups = [...$("groups").content.children];

// ---- camera: the part of the picture that is shown, as x, y, width and height

const whole = svg.getAttribute("viewBox").split(" ").map(Number);
let eye = whole;

function look(box) {
  eye = box;
  svg.setAttribute("viewBox", box.join(" "));
}

function fit() { // small pictures are not enlarged without limit
  const { width, height } = svg.getBoundingClientRect(), [x, y, w, h] = whole;
  const grow = Math.max(1, Math.min(width / w, height / h) / 1.6);
  look([x - ((grow - 1) * w) / 2, y - ((grow - 1) * h) / 2, grow * w, grow * h]);
}

const at = (x, y) => new DOMPoint(x, y).matrixTransform(svg.getScreenCTM().inverse());

function goTo(element, margin) {
  const { left, top, right, bottom } = element.getBoundingClientRect();
  const a = at(left, top), b = at(right, bottom);
  const edge = margin * (b.x - a.x);
  look([a.x - edge, a.y - edge, b.x - a.x + 2 * edge, b.y - a.y + 2 * edge]);
}

svg.onwheel = (event) => {
  event.preventDefault();
  const { x, y } = at(event.clientX, event.clientY), factor = Math.exp(event.deltaY / 500);
  look([x + (eye[0] - x) * factor, y + (eye[1] - y) * factor, eye[2] * factor, eye[3] * factor]);
};

let dragged = 0; // [px]
svg.onpointerdown = () => { dragged = 0; };
svg.onpointermove = ({ buttons, movementX: x, movementY: y }) => {
  if (!buttons) return;
  const unit = 1 / svg.getScreenCTM().a;
  dragged += Math.abs(x) + Math.abs(y);
  look([eye[0] - x * unit, eye[1] - y * unit, eye[2], eye[3]]);
};

// ---- groups: an open one shows its picture in its box

const block = (path) => [...svg.querySelectorAll(".block")].find((one) => one.dataset.path === path);

function open({ dataset: { path }, firstElementChild }, wanted = true) {
  const owner = block(path);
  if (!owner || owner.classList.contains("open") === wanted) return;
  owner.classList.toggle("open", wanted);
  if (!wanted) return owner.lastElementChild.remove();
  const inner = firstElementChild.cloneNode(true), box = owner.querySelector(".box");
  for (const name of ["x", "y", "width", "height"]) inner.setAttribute(name, box.getAttribute(name));
  mark(owner.appendChild(inner));
}

function mark(picture) {
  for (const { classList, dataset } of picture.querySelectorAll(".signal"))
    classList.toggle("plotted", dataset.path in data.signals);
  for (const { dataset: { path } } of groups) block(path)?.classList.add("group");
}

svg.onclick = ({ target }) => {
  if (dragged > 4) return;
  const signal = target.closest(".plotted"), owner = target.closest(".block");
  const group = groups.find(({ dataset }) => dataset.path === owner?.dataset.path);
  if (signal) return plot(signal.dataset.path);
  if (!group) return;
  open(group, !owner.classList.contains("open"));
  if (owner.classList.contains("open")) goTo(owner.lastElementChild, 0.05);
};

// Groups are in the order of their depth.
$("open").onclick = () => groups.forEach((group) => open(group));
$("close").onclick = () => groups.forEach((group) => open(group, false));
$("fit").onclick = fit;
for (const id of ["open", "close"]) $(id).hidden = !groups.length;

// ---- search

const allBlocks = [svg, ...groups].flatMap((one) => [...one.querySelectorAll(".block")]);
const paths = allBlocks.map(({ dataset }) => dataset.path);
let found = [], current = -1;
search.oninput = () => {
  const text = search.value.trim().toLowerCase();
  found = text ? paths.filter((path) => path.toLowerCase().includes(text)) : [];
  current = -1;
  $("hits").textContent = text ? `${found.length} found` : "";
};
search.onkeydown = (event) => {
  if (event.key !== "Enter" || !found.length) return;
  current = (current + 1) % found.length;
  const path = found[current];
  for (const group of groups) if (path.startsWith(`${group.dataset.path}.`)) open(group);
  for (const one of svg.querySelectorAll(".block")) one.classList.toggle("hit", one.dataset.path === path);
  goTo(block(path).querySelector(".box"), 2);
  $("hits").textContent = `${current + 1} of ${found.length}: ${path}`;
};

// ---- chart of a signal

const view = { label: "time", unit: "s", range: null, changed: () => chart.show(data) };
let chart = null;

function plot(path) {
  for (const one of svg.querySelectorAll(".signal")) one.classList.toggle("shown", one.dataset.path === path);
  const { unit, lines } = data.signals[path];
  panel.querySelector(".chart")?.remove();
  panel.hidden = false;
  const curves = lines.map((line, i) => ({ label: lines.length > 1 ? `[${i}]` : "", values: () => line }));
  chart = new Chart(panel, { title: path, unit, curves }, view);
  view.changed();
}
panel.querySelector("button").onclick = () => { panel.hidden = true; };

mark(svg);
fit();
document.body.dataset.state = "ready";
