// A space truss and its robots, drawn by WebGL 2 without a library: light, shadows and a ground grid.
// It needs chart.js. `posed` computes positions by the equations of models/dynamics.
"use strict";

const Scene3d = (() => {
  const THEMES = [
    { rods: "#8795a5", back: "#eef2f6", grid: "#64748b", ghost: "#16a34a", link: "#dfe5ec" },
    { rods: "#c3ced9", back: "#0d1420", grid: "#94a3b8", ghost: "#4ade80", link: "#e8edf3" },
  ];
  const ARROWS = [["force", "thrust", "N", "#dc2626"], ["torque", "torque", "N·m", "#a855f7"]];
  const AXES = [["x", "#dc2626"], ["y", "#16a34a"], ["z", "#2563eb"]];
  const CAMERAS = { // azimuth and elevation of the eye [rad]
    oblique: [-2.08, 0.42], front: [-Math.PI / 2, 0.06], side: [0, 0.06], top: [-Math.PI / 2, Math.PI / 2],
  };
  const EIGHT = [0, 1, 2, 3, 4, 5, 6, 7]; // corners of a box
  const LONGEST = 2.5; // longest arrow [m]
  const MARGIN = 0.5; // around everything visible [m]
  const LOST = 1e5; // points farther away are not drawn [m]
  const [BODY, GROUND, SHADOW] = [0, 1, 2]; // kinds of drawn triangles
  const VIEW = 0.55; // vertical field of view [rad]
  const SUN = [0.36, -0.3, 0.883]; // direction to the light, of length 1

  // ---- kinematics: matrices are lists of nine numbers, row by row --------------------------------------

  const times = (A, B) =>
    [0, 3, 6].flatMap((i) => [0, 1, 2].map((j) => A[i] * B[j] + A[i + 1] * B[j + 3] + A[i + 2] * B[j + 6]));
  const turned = (A, v) => [0, 3, 6].map((i) => A[i] * v[0] + A[i + 1] * v[1] + A[i + 2] * v[2]);
  const sum = (a, b, scale = 1) => [a[0] + scale * b[0], a[1] + scale * b[1], a[2] + scale * b[2]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unitOf = (v) => v.map((a) => a / Math.hypot(...v));
  const mean = (points) => points.reduce((a, b) => sum(a, b)).map((a) => a / points.length);
  const near = (point) => point.every((a) => Math.abs(a) < LOST);

  function quaternion([w, x, y, z]) { // of any length
    const s = 2 / (w * w + x * x + y * y + z * z);
    return [
      1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y),
      s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x),
      s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y),
    ];
  }

  const about = (axis, angle) =>
    quaternion([Math.cos(angle / 2), ...axis.map((a) => a * Math.sin(angle / 2))]);
  const aboutZ = (angle) => about([0, 0, 1], angle);

  function attitude(numbers) { // a quaternion, scalar first, or R_z(psi) R_x(phi) R_y(theta)
    if (numbers.length === 4) return quaternion(numbers);
    const [phi, theta, psi] = numbers;
    return times(aboutZ(psi), times(about([1, 0, 0], phi), about([0, 1, 0], theta)));
  }

  // Modal displacement of one point; `shape` has the modes of its x, then of its y, then of its z.
  const modal = (shape, modes, scale) => [0, 1, 2].map((axis) =>
    modes.reduce((found, mode, k) => found + shape[axis * modes.length + k] * mode * scale, 0));

  // State of a run from its coordinates; `ends` are those of the root and of the joints.
  const stateOf = (ends, q, force = [], torque = []) =>
    ({ root: q.slice(0, ends[0]), joints: q.slice(...ends), modes: q.slice(ends[1]), force, torque });

  // Positions of all bodies for a state with joints [rad or m]; modal coordinates are taken times `scale`.
  function posed(truss, { root, joints, modes }, scale = 1) {
    const R = attitude(root.slice(3)), place = (v) => sum(root, turned(R, v));
    const points = truss.points.map((r, i) => place(sum(r, modal(truss.shapes[i], modes, scale))));
    let next = 0;
    const arms = truss.arms.map((arm) => {
      let p = sum(arm.grasp, modal(arm.translation, modes, scale));
      let A = times(quaternion([2, ...modal(arm.rotation, modes, scale)]), arm.hand); // Cayley's rotation
      const chain = [p], bodies = [[p, A]];
      arm.origins.forEach((origin, j) => {
        p = sum(p, turned(A, origin));
        A = times(A, arm.rotations[j]);
        const moved = joints[next++];
        if (arm.sliding[j]) p = sum(p, turned(A, [0, 0, moved]));
        else A = times(A, aboutZ(moved));
        chain.push(p);
        bodies.push([p, A]);
      });
      const centre = place(sum(p, turned(A, arm.basePosition)));
      const axes = times(R, times(A, arm.baseRotation));
      const placed = bodies.map(([at, turn]) => [place(at), times(R, turn)]);
      const corners = arm.solid.points.map((point, k) => {
        const [at, turn] = placed[arm.solid.bodies[k]];
        return sum(at, turned(turn, point));
      });
      return { chain: [...chain.map(place), centre], centre, axes, corners };
    });
    return { root: root.slice(0, 3), points, arms };
  }

  // ---- parts: capsules are [one end, its radius, other end, its radius, roundness of the ends, colour] ---

  const cornersOf = ({ points, arms }) => [...points, ...arms.flatMap((arm) => arm.corners)];

  // Half of the size of the truss, and a radius of rods that is visible beside it [m].
  function radiiOf(truss) {
    const spans = [0, 1, 2].map((k) => truss.points.map((point) => point[k]));
    const half = spans.map((at) => (Math.max(...at) - Math.min(...at)) / 2);
    const rod = Math.min(0.05, Math.max(0.005, Math.max(...half) / 180));
    return { half, rod };
  }

  const trussOf = (truss, { points }, rod) =>
    truss.rods.map(([a, b]) => [points[a], rod, points[b], rod, 1]);

  function armOf(arm, { chain, corners }, link) { // links have a colour of their own
    const pairs = chain.slice(1).map((b, k) => [chain[k], b]);
    const reach = pairs.reduce((found, [a, b]) => found + Math.hypot(...sum(b, a, -1)), 0);
    const radius = arm.solid.drawn ? 0.004 : 0.035 * reach;
    const links = pairs.map(([a, b]) => [a, radius, b, radius, 1, link]);
    if (arm.solid.drawn) return links;
    const joints = chain.slice(0, -1).map((at) => [at, 1.35 * radius, at, 1.35 * radius, 1]);
    return [...links, ...joints, ...edgesOf(corners)];
  }

  function edgesOf(corners) { // of a box, whose corners are numbered by the signs of z, y and x
    const from = (bit) => EIGHT.filter((k) => !(k & bit)).map((k) => [corners[k], corners[k | bit]]);
    return [1, 2, 4].flatMap(from).map(([a, b]) => [a, 0.014, b, 0.014, 1]);
  }

  function arrowOf(from, along) {
    const size = Math.hypot(...along), head = Math.min(size / 2, 0.34), thick = Math.min(0.035, head / 6);
    if (!(size > 1e-3 * LONGEST)) return [];
    const tip = sum(from, along), neck = sum(tip, along, -head / size);
    return [[from, thick, neck, thick, 0], [neck, 2.6 * thick, tip, 0, 0]];
  }

  // ---- program of the graphics processor ----------------------------------------------------------------

  const PLACED = `#version 300 es
    precision highp float;
    uniform mat4 clip;
    layout(location=0) in vec3 corner; layout(location=1) in vec3 across; layout(location=2) in vec4 colour;
    out vec3 place, normal; out vec4 tint;
    void main() { place = corner; normal = across; tint = colour; gl_Position = clip * vec4(place, 1); }`;
  const LIT = `#version 300 es
    precision highp float;
    in vec3 place, normal; in vec4 tint; out vec4 shown;
    uniform vec3 light, eye, grid, back; uniform vec2 origin; uniform float reach, size; uniform int kind;
    float lines(vec2 at, float cell) {
      vec2 part = at / cell, wide = fwidth(part), off = abs(fract(part - 0.5) - 0.5) / max(wide, 1e-6);
      return (1.0 - min(min(off.x, off.y), 1.0)) * clamp(1.2 - 2.5 * max(wide.x, wide.y), 0.0, 1.0);
    }
    void main() {
      float fade = 1.0 - smoothstep(0.35, 1.0, length(place.xy) / reach);
      if (kind == ${SHADOW}) { shown = vec4(0.78 * back, 1); return; }
      if (kind == ${GROUND}) {
        vec2 at = place.xy + origin;
        float mark = max(0.06, max(0.22 * lines(at, size), 0.5 * lines(at, 5.0 * size)));
        shown = vec4(grid, fade * mark * (gl_FrontFacing ? 1.0 : 0.3));
        return;
      }
      vec3 view = normalize(eye - place);
      vec3 n = normalize(normal == vec3(0) ? cross(dFdx(place), dFdy(place)) : normal);
      if (dot(n, view) < 0.0) n = -n;
      float key = max(dot(n, light), 0.0), gloss = pow(max(dot(n, normalize(light + view)), 0.0), 48.0) * key;
      float rim = 0.18 * pow(1.0 - dot(n, view), 3.0), sky = 0.36 + 0.2 * n.z;
      vec3 base = pow(tint.rgb, vec3(2.2));
      vec3 colour = base * (sky + 0.78 * key) + 0.22 * gloss + rim * (base + 0.15);
      shown = vec4(pow(colour, vec3(1.0 / 2.2)), tint.a);
    }`;

  const SIDES = 12; // of a capsule
  const ROWS = [ // from one pole to the other: elevation, end, whether it is of the side
    [-1, 0], [-0.5, 0], [0, 0], [0, 0, true], [0, 1, true], [0, 1], [0.5, 1], [1, 1],
  ].map(([up, ...more]) => [Math.cos((up * Math.PI) / 2), Math.sin((up * Math.PI) / 2), ...more]);

  // Adds place, normal and colour of all corners, and triangles.
  function addCapsule({ corners, triangles }, [a, first, b, last, round], tint) {
    const along = sum(b, a, -1), size = Math.hypot(...along);
    const axis = size > 1e-7 ? unitOf(along) : [0, 0, 1], slope = (first - last) / Math.max(size, 1e-7);
    const across = cross(axis, Math.abs(axis[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]);
    const side = unitOf(across), other = cross(axis, side);
    ROWS.forEach(([out, up, end, ofSide], r) => {
      const place = end ? b : a, radius = end ? last : first;
      for (let s = 0; s <= SIDES; s++) {
        const turn = (2 * Math.PI * s) / SIDES, k = corners.length / 10, below = k - SIDES - 1;
        const ring = [0, 1, 2].map((i) => Math.cos(turn) * side[i] + Math.sin(turn) * other[i]);
        const cap = round ? [out, up] : [0, 2 * end - 1], [c, d] = ofSide ? [1, slope] : cap;
        for (let i = 0; i < 3; i++) corners.push(place[i] + radius * (out * ring[i] + round * up * axis[i]));
        for (let i = 0; i < 3; i++) corners.push(c * ring[i] + d * axis[i]);
        corners.push(...tint);
        if (s && r && r !== 3 && r !== 5) triangles.push(below - 1, below, k, below - 1, k, k - 1);
      }
    });
  }

  // ---- matrices of the camera: sixteen numbers, column by column -----------------------------------------

  const product = (A, B) => Float32Array.from({ length: 16 }, (_, k) =>
    [0, 1, 2, 3].reduce((found, i) => found + A[(k % 4) + 4 * i] * B[(k - (k % 4)) + i], 0));
  const seenFrom = (axes, eye) =>
    [[1, 0, 0], [0, 1, 0], [0, 0, 1], eye.map((a) => -a)].flatMap((v, k) =>
      [...axes.map((axis) => dot(axis, v)), +(k > 2)]);
  const axesOf = (azimuth, elevation) => {
    const c = Math.cos(elevation), back = [c * Math.cos(azimuth), c * Math.sin(azimuth), Math.sin(elevation)];
    const right = [-Math.sin(azimuth), Math.cos(azimuth), 0];
    return [right, cross(back, right), back];
  };
  const numbers = (colour, alpha = 1) =>
    [...[1, 3, 5].map((k) => parseInt(colour.slice(k, k + 2), 16) / 255), alpha];

  class Scene {
    // The first `state` has force and torque of the bases; `cloud` are poses that the picture shows,
    // `longest` is the largest force and torque.
    constructor(box, truss, state, { target, cloud = [], longest = {}, followed = "nothing" }) {
      this.element = box;
      this.canvas = box.appendChild(element("canvas"));
      box.style.position = "relative";
      this.canvas.style.cssText = "position:absolute;inset:0;width:100%;height:100%;touch-action:pinch-zoom";
      this.gl = this.canvas.getContext("webgl2", { antialias: true });
      if (!this.gl) throw new Error("the browser has no WebGL 2; allow hardware or software rendering");
      Object.assign(this, { truss, longest, state, hidden: new Set() });
      this.goal = target && posed(truss, target, 0);
      this.pose = posed(truss, state);
      const { half, rod } = radiiOf(truss);
      this.rod = rod;
      this.half = half.map((a) => a + 2 * MARGIN);
      const corners = [...cloud, this.pose, this.goal].flatMap((pose) => (pose ? cornersOf(pose) : []));
      this.cloud = corners.filter(near);
      this.lost = this.cloud.length < corners.length; // the motion is too long for a picture of all of it
      const extent = ([low, high], value) => [Math.min(low, value), Math.max(high, value)];
      this.bounds = [0, 1, 2].map((k) =>
        this.cloud.map((point) => point[k]).reduce(extent, [Infinity, -Infinity]));
      this.prepare();
      this.look("oblique", followed);
      this.listen();
    }

    get dark() { return matchMedia("(prefers-color-scheme: dark)").matches; }

    prepare() {
      const { gl } = this, program = gl.createProgram();
      for (const [kind, text] of [[gl.VERTEX_SHADER, PLACED], [gl.FRAGMENT_SHADER, LIT]]) {
        const shader = gl.createShader(kind);
        gl.shaderSource(shader, text);
        gl.compileShader(shader);
        if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
        gl.attachShader(program, shader);
      }
      gl.linkProgram(program);
      gl.useProgram(program);
      this.uniform = (name) => gl.getUniformLocation(program, name);
      for (const kind of [gl.ARRAY_BUFFER, gl.ELEMENT_ARRAY_BUFFER]) gl.bindBuffer(kind, gl.createBuffer());
      [3, 3, 4].forEach((size, place) => {
        gl.enableVertexAttribArray(place);
        gl.vertexAttribPointer(place, size, gl.FLOAT, false, 40, 12 * place);
      });
      gl.enable(gl.DEPTH_TEST);
      gl.depthFunc(gl.LEQUAL);
      gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    }

    listen() {
      const { canvas } = this;
      canvas.oncontextmenu = (event) => event.preventDefault();
      canvas.onpointerdown = (event) => canvas.setPointerCapture(event.pointerId);
      canvas.onpointermove = (event) => {
        if (!event.buttons) return;
        const { movementX: x, movementY: y } = event, [azimuth, elevation] = this.angles;
        if (event.buttons > 1 || event.shiftKey) {
          const unit = (this.distance * 2 * Math.tan(VIEW / 2)) / canvas.clientHeight;
          this.moved = sum(sum(this.moved, this.axes[0], -x * unit), this.axes[1], y * unit);
        } else {
          const up = Math.max(-Math.PI / 2, elevation + 0.008 * y);
          this.angles = [azimuth - 0.008 * x, Math.min(Math.PI / 2, up)];
        }
        this.draw();
      };
      canvas.onwheel = (event) => {
        event.preventDefault();
        this.zoom = Math.min(20, Math.max(0.02, this.zoom * Math.exp(0.001 * event.deltaY)));
        this.draw();
      };
      canvas.ondblclick = () => this.look(this.camera, this.followed);
      new ResizeObserver(() => this.draw()).observe(this.element); // at once, before the frame of the new size
      matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
    }

    look(camera, followed) { // "nothing" or "truss"
      const angles = CAMERAS[camera] ?? CAMERAS.oblique;
      Object.assign(this, { camera, followed, angles, zoom: 1, moved: [0, 0, 0] });
      this.draw();
    }

    show(state, scale = 1) {
      this.state = state;
      this.pose = posed(this.truss, state, scale);
      this.draw();
    }

    // All parts by name: capsules, or corners and triangles; layers above 0 are transparent.
    parts() {
      const parts = [], { rods, ghost, link } = THEMES[+this.dark], { truss, pose, goal, rod, state } = this;
      const part = (name, colour, capsules, more = {}) =>
        parts.push({ name, legend: name, colour, alpha: 1, layer: 0, capsules, faces: [], ...more });
      part("truss", rods, trussOf(truss, pose, rod));
      if (goal) part("target", ghost, trussOf(truss, goal, rod), { alpha: this.dark ? 0.5 : 0.3, layer: 2 });
      truss.arms.forEach((arm, k) => {
        const legend = `robot ${k + 1}`, colour = COLOURS[k % COLOURS.length], { faces, drawn } = arm.solid;
        part(legend, colour, armOf(arm, pose.arms[k], link));
        const glass = drawn ? {} : { alpha: this.dark ? 0.5 : 0.32, layer: 1 }; // the arm lies in the box
        part(`base ${k + 1}`, colour, [], { ...glass, legend, corners: pose.arms[k].corners, faces });
        if (!goal) return;
        const look = { alpha: this.dark ? 0.5 : 0.3, layer: 2, corners: goal.arms[k].corners, faces };
        part(`target of ${legend}`, ghost, armOf(arm, goal.arms[k]), { ...look, legend: "target" });
      });
      for (const [key, what, unit, colour] of ARROWS) {
        if (!this.longest[key] || !state[key]?.length) continue;
        const each = pose.arms.map((arm, k) => {
          const push = state[key].slice(3 * k, 3 * k + 3).map((a) => (a * LONGEST) / this.longest[key]);
          return arrowOf(arm.centre, turned(arm.axes, push));
        });
        part(`${what}, at most ${quantity(this.longest[key], unit)}`, colour, each.flat());
      }
      const middle = this.bounds.map(([low, high], k) => (k < 2 ? (low + high) / 2 : low - MARGIN));
      AXES.forEach(([name, colour], k) =>
        part(`${name}, 1 m`, colour, arrowOf(middle, [0, 1, 2].map((axis) => +(axis === k)))));
      return parts;
    }

    legend() { // names and colours in the order of their first part
      const found = new Map();
      for (const { legend, colour } of this.parts()) found.set(legend, found.get(legend) ?? colour);
      return [...found];
    }

    toggle(name) {
      if (!this.hidden.delete(name)) this.hidden.add(name);
      this.draw();
    }

    // Centre and relative positions of the points that the camera shows at zoom 1 [m].
    around() {
      const middle = this.bounds.map(([low, high]) => (low + high) / 2);
      if (this.followed === "nothing") return [middle, this.cloud.map((point) => sum(point, middle, -1))];
      const centre = mean(this.pose.points);
      if (near(centre)) this.seen = centre;
      return [this.seen ?? middle, EIGHT.map((k) => this.half.map((a, axis) => (k & (1 << axis) ? a : -a)))];
    }

    // Coordinates on the screen are relative to the target of the camera: single precision suffices far away.
    upload(parts, origin) {
      const { gl } = this, mesh = { corners: [], triangles: [] }, { corners, triangles } = mesh;
      const layers = [0, 1, 2].map((layer) => {
        const start = triangles.length;
        for (const part of parts) {
          if (part.layer !== layer || this.hidden.has(part.legend)) continue;
          const tint = numbers(part.colour, part.alpha);
          for (const [a, first, b, last, roundness, colour] of part.capsules) {
            if (!(near(a) && near(b))) continue;
            const ends = [sum(a, origin, -1), first, sum(b, origin, -1), last, roundness];
            addCapsule(mesh, ends, colour ? numbers(colour, part.alpha) : tint);
          }
          if (!part.faces.length || !part.corners.every(near)) continue;
          const base = corners.length / 10, [I, J, K] = part.faces;
          for (const corner of part.corners) corners.push(...sum(corner, origin, -1), 0, 0, 0, ...tint);
          for (let k = 0; k < I.length; k++) triangles.push(base + I[k], base + J[k], base + K[k]);
        }
        return [start, triangles.length - start];
      });
      const ground = corners.length / 10; // two triangles more
      for (const [x, y] of [[-1, -1], [1, -1], [1, 1], [-1, 1]])
        corners.push(x * this.reach, y * this.reach, this.floor - origin[2], 0, 0, 1, 0, 0, 0, 1);
      triangles.push(ground, ground + 1, ground + 2, ground, ground + 2, ground + 3);
      gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(corners), gl.DYNAMIC_DRAW);
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint32Array(triangles), gl.DYNAMIC_DRAW);
      return [...layers, [triangles.length - 6, 6]];
    }

    // Camera and light for a picture of this shape; matrices map positions relative to the target.
    aim(shape) {
      const [centre, offsets] = this.around(), axes = axesOf(...this.angles);
      const tangents = [shape * Math.tan(VIEW / 2), Math.tan(VIEW / 2)];
      let fit = 0, size = MARGIN; // distance from which all points are visible, and the radius around them
      for (const offset of offsets) {
        const z = dot(axes[2], offset);
        tangents.forEach((tangent, i) => {
          fit = Math.max(fit, z + (Math.abs(dot(axes[i], offset)) + MARGIN) / tangent);
        });
        size = Math.max(size, Math.hypot(...offset));
      }
      const target = sum(centre, this.moved), distance = fit * this.zoom;
      Object.assign(this, { axes, target, distance, reach: 4 * size });
      this.floor = Math.max(this.bounds[2][0] - MARGIN, centre[2] - 3 * size);
      this.cell = 10 ** Math.max(0, Math.round(Math.log10(size / 12)));
      this.eye = axes[2].map((a) => a * this.distance);
      const low = this.distance / 100, high = this.distance + 2.2 * this.reach, depth = low - high;
      const lens = [1 / tangents[0], 0, 0, 0, 0, 1 / tangents[1], 0, 0];
      lens.push(0, 0, (low + high) / depth, -1, 0, 0, (2 * low * high) / depth, 0);
      this.clip = product(lens, seenFrom(axes, this.eye));
      // Along the light to the floor, column by column.
      const [x, y] = [0, 1].map((k) => SUN[k] / SUN[2]), ground = this.floor - this.target[2];
      const flat = [1, 0, 0, 0, 0, 1, 0, 0, -x, -y, 0, 0, x * ground, y * ground, ground, 1];
      this.shade = product(this.clip, flat);
    }

    paint([start, count], kind, matrix = this.clip) {
      const { gl, uniform } = this;
      gl.uniformMatrix4fv(uniform("clip"), false, matrix);
      gl.uniform1i(uniform("kind"), kind);
      gl.drawElements(gl.TRIANGLES, count, gl.UNSIGNED_INT, 4 * start);
    }

    draw(width = this.element.clientWidth, height = this.element.clientHeight, density = 0) {
      if (!(width && height)) return;
      const { gl, canvas, uniform } = this, { grid, back } = THEMES[+this.dark];
      const scale = density || Math.min(2, devicePixelRatio);
      [canvas.width, canvas.height] = [width, height].map((side) => Math.round(side * scale));
      this.aim(width / height);
      const layers = this.upload(this.parts(), this.target), ground = layers.pop();
      const vectors = { light: SUN, eye: this.eye, grid: numbers(grid), back: numbers(back) };
      for (const [name, value] of Object.entries(vectors)) gl.uniform3fv(uniform(name), value.slice(0, 3));
      gl.uniform2fv(uniform("origin"), [0, 1].map((k) => this.target[k] % (5 * this.cell)));
      gl.uniform1f(uniform("reach"), this.reach);
      gl.uniform1f(uniform("size"), this.cell);
      gl.viewport(0, 0, canvas.width, canvas.height);
      gl.clearColor(...numbers(back));
      gl.disable(gl.BLEND);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.depthMask(false); // of the ground, which covers nothing
      for (const layer of layers.slice(0, 2)) this.paint(layer, SHADOW, this.shade);
      gl.enable(gl.BLEND);
      this.paint(ground, GROUND);
      gl.depthMask(true);
      for (const layer of layers) { // first the depths, so that only the nearest surface is blended
        gl.colorMask(false, false, false, false);
        this.paint(layer, BODY);
        gl.colorMask(true, true, true, true);
        this.paint(layer, BODY);
      }
    }

    picture(width, height) { // of so many pixels, as a data URL
      this.draw(width, height, 1);
      return this.canvas.toDataURL("image/png");
    }
  }

  // Panel of a page that simulates. `names` are the signals of coordinates, forces and torques.
  function panel({ truss, names, ends, start, target }) {
    const longest = { force: 0, torque: 0 };
    let scene;
    return {
      mount(box) {
        box.style.height = "26rem";
        const options = { target: target && stateOf(ends, target), longest, followed: "truss" };
        scene = new Scene(box, truss, stateOf(ends, start), options);
      },
      update(_, signals) {
        const [coordinates, force, torque] = names.map((name) => Array.from(signals[name] ?? []));
        for (const [name, values] of [["force", force], ["torque", torque]])
          for (let k = 0; k < values.length; k += 3)
            longest[name] = Math.max(longest[name], Math.hypot(...values.slice(k, k + 3)));
        scene.show(stateOf(ends, coordinates, force, torque));
      },
      get scene() { return scene; },
    };
  }

  return { Scene, panel, posed, stateOf, near };
})();
