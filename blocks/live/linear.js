"use strict";
// Linear analysis in the worker: poles, frequency response and margins of a loop, the rows of [A, B; C, D].
// Complex numbers are [real, imaginary].

const plus = ([a, b], [c, d]) => [a + c, b + d], minus = ([a, b], [c, d]) => [a - c, b - d];
const times = ([a, b], [c, d]) => [a * c - b * d, a * d + b * c], conjugate = ([a, b]) => [a, -b];
const scaled = ([a, b], factor) => [a * factor, b * factor], size = ([a, b]) => Math.abs(a) + Math.abs(b);
const divided = (p, q) => scaled(times(p, conjugate(q)), 1 / (q[0] * q[0] + q[1] * q[1]));

/** Balance A of [A, B; C, D] by powers of two, and bring it to Hessenberg form by reflections. */
function hessenberg(n, M) {
  for (let done = false; !done; ) {
    done = true;
    for (let i = 0; i < n; ++i) {
      const others = [...M.keys()].filter((j) => j !== i && j < n);
      const row = others.reduce((sum, j) => sum + Math.abs(M[i][j]), 0);
      const column = others.reduce((sum, j) => sum + Math.abs(M[j][i]), 0);
      let f = 1;
      if (!row || !column) continue;
      while (column * f * f < row / 4) f *= 2;
      while (column * f * f > row * 4) f /= 2;
      if (f === 1) continue;
      done = false;
      M[i] = M[i].map((value) => value / f);
      for (const each of M) each[i] *= f;
    }
  }
  for (let k = 0; k < n - 2; ++k) {
    const v = M.map((row, i) => (i > k && i < n ? row[k] : 0)), norm = Math.hypot(...v);
    if (!norm) continue;
    v[k + 1] += v[k + 1] < 0 ? -norm : norm;
    const scale = 2 / v.reduce((sum, e) => sum + e * e, 0);
    for (let j = 0; j <= n; ++j) {
      const along = scale * v.reduce((sum, e, i) => sum + e * M[i][j], 0);
      v.forEach((e, i) => { M[i][j] -= along * e; });
    }
    for (const row of M) {
      const along = scale * v.reduce((sum, e, j) => sum + e * row[j], 0);
      v.forEach((e, j) => { row[j] -= along * e; });
    }
    for (let i = k + 2; i < n; ++i) M[i][k] = 0;
  }
  return M;
}

/** Return the eigenvalues of A in Hessenberg form, by complex QR with Wilkinson's shifts. */
function eigenvalues(n, M) {
  const H = M.map((row) => row.map((value) => [value, 0])), found = []; // the border is not used
  for (let m = n - 1, turns = 0; m >= 0; ) {
    let l = m;
    while (l > 0 && size(H[l][l - 1]) > Number.EPSILON * (size(H[l - 1][l - 1]) + size(H[l][l]))) --l;
    if (l === m || turns > 300) {
      found.push(H[m][m]);
      m -= 1;
      turns = 0;
      continue;
    }
    // The eigenvalue of the last two by two block that is nearer to its last element.
    const half = scaled(minus(H[m - 1][m - 1], H[m][m]), 0.5), product = times(H[m - 1][m], H[m][m - 1]);
    const [x, y] = plus(times(half, half), product), angle = Math.atan2(y, x) / 2;
    let root = scaled([Math.cos(angle), Math.sin(angle)], Math.sqrt(Math.hypot(x, y)));
    if (half[0] * root[0] + half[1] * root[1] < 0) root = scaled(root, -1);
    const sum = plus(half, root);
    let shift = size(sum) ? minus(H[m][m], divided(product, sum)) : H[m][m];
    if (++turns % 20 === 0) shift = plus(shift, [size(H[m][m - 1]), 0]); // an exceptional shift
    for (let i = l; i <= m; ++i) H[i][i] = minus(H[i][i], shift);
    const turned = [];
    for (let k = l; k < m; ++k) { // Q'H, of rotations [c, s; -s*, c*]
      const norm = Math.hypot(...H[k][k], ...H[k + 1][k]);
      const [c, s] = [H[k][k], H[k + 1][k]].map((z) => scaled(conjugate(z), 1 / (norm || 1)));
      if (!norm) continue;
      turned.push([k, c, s]);
      for (let j = k; j <= m; ++j) {
        const [p, q] = [H[k][j], H[k + 1][j]];
        H[k][j] = plus(times(c, p), times(s, q));
        H[k + 1][j] = minus(times(conjugate(c), q), times(conjugate(s), p));
      }
    }
    for (const [k, c, s] of turned) { // times Q
      for (let i = l; i <= Math.min(m, k + 1); ++i) {
        const [p, q] = [H[i][k], H[i][k + 1]];
        H[i][k] = plus(times(conjugate(c), p), times(conjugate(s), q));
        H[i][k + 1] = minus(times(c, q), times(s, p));
      }
    }
    for (let i = l; i <= m; ++i) H[i][i] = plus(H[i][i], shift);
  }
  return found;
}

/** Return the response at a frequency w [rad/s], of [A, B; C, D] with A in Hessenberg form. */
function response(n, M, w) {
  // Elimination in [jw - A, B; -C, D] leaves D + C (jw - A)^-1 B in the corner.
  const T = M.map((row, i) => row.map((value, j) => [j < n ? -value : value, i === j && i < n ? w : 0]));
  for (let k = 0; k < n; ++k) {
    if (k + 1 < n && size(T[k + 1][k]) > size(T[k][k])) [T[k], T[k + 1]] = [T[k + 1], T[k]];
    for (const i of k + 1 < n ? [k + 1, n] : [n]) {
      if (!size(T[i][k])) continue;
      const factor = divided(T[i][k], T[k][k]);
      for (let j = k; j <= n; ++j) T[i][j] = minus(T[i][j], times(factor, T[k][j]));
    }
  }
  return T[n][n];
}

/** Return closed-loop poles, Bode plot and margins of a loop gain for negative feedback. */
function analysed(rows) {
  const n = rows.length - 1, D = rows[n][n];
  const closed = rows.map((row, i) => row.map((value, j) => value - (rows[i][n] * rows[n][j]) / (1 + D)));
  const M = hessenberg(n, rows), open = eigenvalues(n, M), poles = eigenvalues(n, hessenberg(n, closed));
  const sizes = [...poles, ...open].map(([x, y]) => Math.hypot(x, y)), fast = Math.max(...sizes, 1e-300);
  const slow = Math.min(fast, ...sizes.filter((s) => s > 1e-9 * fast)), low = 0.01 * slow, high = 100 * fast;
  const number = n > 60 ? 300 : 600;
  const grid = Array.from({ length: number }, (_, k) => low * (high / low) ** (k / (number - 1)));
  for (const [x, y] of [...poles, ...open]) { // dense around resonances
    const width = Math.min(0.3 * y, 30 * Math.max(Math.abs(x), 1e-4 * y)) / Math.sinh(4);
    if (y > low && y < high && Math.abs(x) < 0.3 * y)
      for (let k = -8; k <= 8; ++k) grid.push(y + width * Math.sinh(k / 2));
  }
  const omega = Float64Array.from(grid).sort(), L = (w) => response(n, M, w), values = Array.from(omega, L);
  const turn = 2 * Math.PI, phase = [];
  values.forEach(([x, y], k) => { // the first one from -270° to 90°, then without jumps
    const angle = Math.atan2(y, x), before = k ? phase[k - 1] : -Math.PI / 2 + 1e-9;
    phase.push(angle + turn * Math.round((before - angle) / turn));
  });
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
  const unity = zeros(([x, y]) => x * x + y * y - 1), [xr, xi] = L(1e-6 * slow);
  const real = zeros(([, y]) => y).filter(([, [x]]) => x < -1e-9), factors = real.map(([, [x]]) => -1 / x);
  for (const S of [1 / (1 + D), (1 + xr) / ((1 + xr) ** 2 + xi * xi)])
    if (S < -1e-9 || S > 1 + 1e-9) factors.push(S / (S - 1));
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
