"use strict";
// Linear analysis in the worker: poles, frequency response and margins of a loop {n, A, B, C, D}, A row by row.

/** Balance a matrix by powers of two, then reduce it to Hessenberg form H, with b and c in the same coordinates. */
function hessenberg(n, A, B, C) {
  const H = A.slice(), b = B.slice(), c = C.slice();
  for (let done = false; !done; ) {
    done = true;
    for (let i = 0; i < n; ++i) {
      let row = 0, column = 0, f = 1;
      for (let j = 0; j < n; ++j) if (j !== i) [row, column] = [row + Math.abs(H[i * n + j]), column + Math.abs(H[j * n + i])];
      if (!row || !column) continue;
      while (column * f * f < row / 4) f *= 2;
      while (column * f * f > row * 4) f /= 2;
      if (f === 1) continue;
      done = false;
      for (let j = 0; j < n; ++j) [H[i * n + j], H[j * n + i]] = j === i ? [H[i * n + i], H[i * n + i]] : [H[i * n + j] / f, H[j * n + i] * f];
      [b[i], c[i]] = [b[i] / f, c[i] * f];
    }
  }
  for (let k = 0; k < n - 2; ++k) { // Householder reflections
    const v = new Float64Array(n);
    let norm = 0;
    for (let i = k + 1; i < n; ++i) norm = Math.hypot(norm, (v[i] = H[i * n + k]));
    if (!norm) continue;
    v[k + 1] += v[k + 1] < 0 ? -norm : norm;
    const scale = 2 / v.reduce((s, e) => s + e * e, 0);
    const reflect = (M, start, step) => { // subtracts 2 v v' M / v'v from a vector in M
      let s = 0;
      for (let i = k + 1; i < n; ++i) s += v[i] * M[start + i * step];
      for (let i = k + 1; i < n; ++i) M[start + i * step] -= scale * s * v[i];
    };
    for (let j = 0; j < n; ++j) reflect(H, j, n);
    for (let i = 0; i < n; ++i) reflect(H, i * n, 1);
    reflect(b, 0, 1);
    reflect(c, 0, 1);
    for (let i = k + 2; i < n; ++i) H[i * n + k] = 0;
  }
  return [H, b, c];
}

/** Return the eigenvalues [real, imaginary] of a Hessenberg matrix, by complex QR with Wilkinson's shifts. */
function eigenvalues(n, H) {
  const re = H.slice(), im = new Float64Array(n * n), found = [];
  const root = (x, y) => { // principal square root
    const r = Math.hypot(x, y), s = Math.sqrt((r + Math.abs(x)) / 2);
    return s === 0 ? [0, 0] : x >= 0 ? [s, y / (2 * s)] : [Math.abs(y) / (2 * s), y < 0 ? -s : s];
  };
  const size = (k) => Math.abs(re[k]) + Math.abs(im[k]);
  for (let m = n - 1, turns = 0; m >= 0; ) {
    let l = m;
    for (; l > 0; --l) {
      const near = size((l - 1) * n + l - 1) + size(l * n + l);
      if (size(l * n + l - 1) <= Number.EPSILON * near) break;
    }
    const at = m * n + m;
    if (l === m || turns > 300) {
      found.push([re[at], im[at]]);
      m -= 1;
      turns = 0;
      continue;
    }
    // The eigenvalue of the last two by two block that is nearer to its last element.
    const above = at - n - 1, [dr, di] = [(re[above] - re[at]) / 2, (im[above] - im[at]) / 2];
    const [pr, pi, qr, qi] = [re[at - n], im[at - n], re[at - 1], im[at - 1]];
    const [br, bi] = [pr * qr - pi * qi, pr * qi + pi * qr];
    let [wr, wi] = root(dr * dr - di * di + br, 2 * dr * di + bi);
    if (dr * wr + di * wi < 0) [wr, wi] = [-wr, -wi];
    const [ur, ui] = [dr + wr, di + wi], u2 = ur * ur + ui * ui;
    let sr = re[at], si = im[at];
    if (u2) [sr, si] = [sr - (br * ur + bi * ui) / u2, si - (bi * ur - br * ui) / u2];
    if (++turns % 20 === 0) sr += size(at - 1); // an exceptional shift
    for (let i = l; i <= m; ++i) [re[i * n + i], im[i * n + i]] = [re[i * n + i] - sr, im[i * n + i] - si];
    const turned = [];
    for (let k = l; k < m; ++k) { // Q'H, of rotations [c, s; -s*, c]
      const a = k * n + k, b = a + n, norm = Math.hypot(re[a], im[a], re[b], im[b]);
      const [cr, ci, tr, ti] = norm ? [re[a] / norm, im[a] / norm, re[b] / norm, im[b] / norm] : [1, 0, 0, 0];
      turned.push([cr, ci, tr, ti]);
      for (let j = k; j <= m; ++j) {
        const p = k * n + j, q = p + n, xr = re[p], xi = im[p], yr = re[q], yi = im[q];
        re[p] = cr * xr + ci * xi + tr * yr + ti * yi;
        im[p] = cr * xi - ci * xr + tr * yi - ti * yr;
        re[q] = cr * yr - ci * yi - tr * xr + ti * xi;
        im[q] = cr * yi + ci * yr - tr * xi - ti * xr;
      }
    }
    for (let k = l; k < m; ++k) { // times Q
      const [cr, ci, tr, ti] = turned[k - l];
      for (let i = l; i <= Math.min(m, k + 1); ++i) {
        const p = i * n + k, q = p + 1, xr = re[p], xi = im[p], yr = re[q], yi = im[q];
        re[p] = cr * xr - ci * xi + tr * yr - ti * yi;
        im[p] = cr * xi + ci * xr + tr * yi + ti * yr;
        re[q] = cr * yr + ci * yi - tr * xr - ti * xi;
        im[q] = cr * yi - ci * yr - tr * xi + ti * xr;
      }
    }
    for (let i = l; i <= m; ++i) [re[i * n + i], im[i * n + i]] = [re[i * n + i] + sr, im[i * n + i] + si];
  }
  return found;
}

/** Return the function of a frequency [rad/s] that gives the response [real, imaginary] of a loop. */
function responder(n, A, B, C, D) {
  const [H, b, c] = hessenberg(n, A, B, C), re = new Float64Array(n * n), im = new Float64Array(n * n);
  const xr = new Float64Array(n), xi = new Float64Array(n);
  const exchange = (v, p, q) => { const kept = v[p]; v[p] = v[q]; v[q] = kept; };
  return (w) => {
    xr.set(b);
    xi.fill(0);
    for (let i = 0; i < n * n; ++i) re[i] = -H[i];
    im.fill(0);
    for (let i = 0; i < n; ++i) im[i * n + i] = w;
    for (let k = 0; k < n - 1; ++k) { // elimination with the larger of two neighbouring rows
      const p = k * n, q = p + n;
      if (Math.abs(re[q + k]) + Math.abs(im[q + k]) > Math.abs(re[p + k]) + Math.abs(im[p + k])) {
        for (let j = k; j < n; ++j) exchange(re, p + j, q + j), exchange(im, p + j, q + j);
        exchange(xr, k, k + 1);
        exchange(xi, k, k + 1);
      }
      const dr = re[p + k], di = im[p + k], er = re[q + k], ei = im[q + k], size = dr * dr + di * di;
      if (!size || (!er && !ei)) continue;
      const fr = (er * dr + ei * di) / size, fi = (ei * dr - er * di) / size;
      for (let j = k; j < n; ++j) {
        const ur = re[p + j], ui = im[p + j];
        re[q + j] -= fr * ur - fi * ui;
        im[q + j] -= fr * ui + fi * ur;
      }
      xr[k + 1] -= fr * xr[k] - fi * xi[k];
      xi[k + 1] -= fr * xi[k] + fi * xr[k];
    }
    let yr = D, yi = 0;
    for (let i = n - 1; i >= 0; --i) {
      let sr = xr[i], si = xi[i];
      for (let j = i + 1, k = i * n + j; j < n; ++j, ++k) {
        sr -= re[k] * xr[j] - im[k] * xi[j];
        si -= re[k] * xi[j] + im[k] * xr[j];
      }
      const dr = re[i * n + i], di = im[i * n + i], size = dr * dr + di * di;
      xr[i] = (sr * dr + si * di) / size;
      xi[i] = (si * dr - sr * di) / size;
      yr += c[i] * xr[i];
      yi += c[i] * xi[i];
    }
    return [yr, yi];
  };
}

/** Return closed-loop poles, Bode plot and margins of a loop gain for negative feedback. */
function analysed({ n, A, B, C, D }) {
  const closed = A.map((a, k) => a - (B[Math.floor(k / n)] * C[k % n]) / (1 + D));
  const poles = eigenvalues(n, hessenberg(n, closed, B, C)[0]), open = eigenvalues(n, hessenberg(n, A, B, C)[0]);
  const sizes = [...poles, ...open].map(([x, y]) => Math.hypot(x, y)), fast = Math.max(...sizes, 1e-300);
  const slow = Math.min(fast, ...sizes.filter((s) => s > 1e-9 * fast)), [low, high] = [0.01 * slow, 100 * fast];
  const number = n > 60 ? 300 : 600, grid = Array.from({ length: number }, (_, k) => low * (high / low) ** (k / (number - 1)));
  for (const [x, y] of [...poles, ...open]) { // dense around resonances
    if (y > low && y < high && Math.abs(x) < 0.3 * y)
      for (let k = -8; k <= 8; ++k) grid.push(y + (Math.sinh(k / 2) / Math.sinh(4)) * Math.min(0.3 * y, 30 * Math.max(Math.abs(x), 1e-4 * y)));
  }
  const omega = Float64Array.from(grid).sort(), L = responder(n, A, B, C, D), values = Array.from(omega, L);
  const turn = 2 * Math.PI, phase = [];
  for (const [x, y] of values) {
    const angle = Math.atan2(y, x), before = phase.length ? phase[phase.length - 1] : 0;
    phase.push(phase.length ? angle + turn * Math.round((before - angle) / turn) : angle > 0.5 * Math.PI + 1e-9 ? angle - turn : angle);
  }
  // Zeros of a function along the grid, by bisection to the last digits.
  const zeros = (f) => {
    const at = values.map(f), found = [];
    for (let k = 1; k < omega.length; ++k) {
      if (!(at[k - 1] * at[k] < 0)) continue;
      let a = omega[k - 1], b = omega[k];
      for (let turns = 0; turns < 60 && b - a > 1e-15 * b; ++turns) {
        const middle = (a + b) / 2;
        if (f(L(middle)) * at[k - 1] > 0) a = middle; else b = middle;
      }
      found.push([(a + b) / 2, L((a + b) / 2)]);
    }
    return found;
  };
  const unity = zeros(([x, y]) => x * x + y * y - 1), real = zeros(([, y]) => y).filter(([, [x]]) => x < -1e-9);
  const factors = real.map(([, [x]]) => -1 / x), [xr, xi] = L(1e-6 * slow);
  for (const S of [1 / (1 + D), (1 + xr) / ((1 + xr) ** 2 + xi * xi)]) if (S < -1e-9 || S > 1 + 1e-9) factors.push(S / (S - 1));
  const angles = unity.map(([, [x, y]]) => Math.atan2(-y, -x)); // phase of L, from -180°
  return {
    poles, omega, magnitude: Float64Array.from(values, ([x, y]) => 20 * Math.log10(Math.hypot(x, y))),
    phase: Float64Array.from(phase, (angle) => (angle * 180) / Math.PI),
    stable: poles.every(([x]) => x <= 1e-9 * fast),
    crossover: Math.max(...unity.map(([w]) => w), -Infinity),
    up: Math.min(...factors.filter((f) => f > 1), Infinity),
    down: Math.max(...factors.filter((f) => f < 1), 0),
    angle: (Math.min(...angles.map(Math.abs), Infinity) * 180) / Math.PI,
    delay: Math.min(...unity.map(([w], k) => ((angles[k] + turn) % turn) / w), Infinity),
  };
}
