/* Weighted least squares within limits: the twin of bounded_least_squares.py, which says what is
   computed and why it ends. What changes here changes there.

   Matrices are kept by columns, of a multiple of four rows, so that all work is done in whole vectors. */

#ifndef TF_BOUNDED_LEAST_SQUARES
#define TF_BOUNDED_LEAST_SQUARES
#include <string.h>

#define TF_ROUNDS 100 /* as in bounded_least_squares.py */
#define TF_FAR 1e3
#define TF_4(p) (*(tf_lanes4*)(p))
#define TF_C4(p) (*(const tf_lanes4*)(p))
#define TF_CHOSEN(where, a, b) /* in lanes */ \
  ((tf_lanes4)(((tf_bits4)(where) & (tf_bits4)(a)) | (~(tf_bits4)(where) & (tf_bits4)(b))))

static inline double tf_total(tf_lanes4 s) { return (s[0] + s[2]) + (s[1] + s[3]); }

/* s + v x */
TF_INLINE tf_lanes4 tf_more(tf_lanes4 s, tf_lanes4 v, double x) { return tf_4_fma(v, tf_4_all(x), s); }

static inline double tf_clipped(double z, double low, double high) {
  double raised = z < low ? low : z;
  return raised > high ? high : raised;
}

/* to += sign x the sum over the chosen columns k of a_k b_k^T: rows i.. and i + 4.. of columns j.. */
TF_INLINE void tf_tile(int rows, double* to, double sign, const double* a, const double* b,
                       const int* chosen, int count, int i, int j) {
  tf_lanes4 s0 = {0}, s1 = {0}, s2 = {0}, s3 = {0}, r0 = {0}, r1 = {0}, r2 = {0}, r3 = {0};
  const int below = i + 4 < rows ? 4 : 0; /* the last four rows may have none below them */
  for (int k = 0; k < count; ++k) {
    const double *x = a + chosen[k] * rows + i, *y = b + chosen[k] * rows + j;
    s0 = tf_more(s0, TF_C4(x), y[0]), r0 = tf_more(r0, TF_C4(x + below), y[0]);
    s1 = tf_more(s1, TF_C4(x), y[1]), r1 = tf_more(r1, TF_C4(x + below), y[1]);
    s2 = tf_more(s2, TF_C4(x), y[2]), r2 = tf_more(r2, TF_C4(x + below), y[2]);
    s3 = tf_more(s3, TF_C4(x), y[3]), r3 = tf_more(r3, TF_C4(x + below), y[3]);
  }
  double *c0 = to + j * rows + i, *c1 = c0 + rows, *c2 = c1 + rows, *c3 = c2 + rows;
  TF_4(c0) += sign * s0, TF_4(c1) += sign * s1, TF_4(c2) += sign * s2, TF_4(c3) += sign * s3;
  if (!below) return;
  TF_4(c0 + 4) += sign * r0, TF_4(c1 + 4) += sign * r1;
  TF_4(c2 + 4) += sign * r2, TF_4(c3 + 4) += sign * r3;
}

/* u = L D L^T becomes L D (only the lower triangle is read or right), l becomes L with zeros in place
   of the ones. Returns 0 if u is not positive definite. */
TF_INLINE int tf_factorize(int rows, double* u, double* l, double* inverse, const int* all) {
  for (int j = 0; j < rows; j += 4) {
    for (int i = j; j && i < rows; i += 8) tf_tile(rows, u, -1.0, u, l, all, j, i, j);
    for (int c = j; c < j + 4; ++c) {
      double *column = u + c * rows, *scaled = l + c * rows;
      if (!(column[c] > 0)) return 0;
      inverse[c] = 1.0 / column[c];
      for (int i = j; i < rows; i += 4) TF_4(scaled + i) = inverse[c] * TF_4(column + i);
      for (int e = c + 1; e < j + 4; ++e)
        for (int i = j; i < rows; i += 4)
          TF_4(u + e * rows + i) = tf_more(TF_4(u + e * rows + i), TF_4(column + i), -scaled[e]);
      for (int i = j; i <= c; ++i) scaled[i] = 0;
    }
  }
  return 1;
}

/* to = the products of four columns with x, from the first row on. */
TF_INLINE void tf_products(int rows, int first, double* to, const double* a, const double* x) {
  tf_lanes4 s0 = {0}, s1 = {0}, s2 = {0}, s3 = {0};
  for (int i = first; i < rows; i += 4) {
    const tf_lanes4 y = TF_C4(x + i);
    s0 = tf_4_fma(TF_C4(a + i), y, s0), s1 = tf_4_fma(TF_C4(a + i + rows), y, s1);
    s2 = tf_4_fma(TF_C4(a + i + 2 * rows), y, s2), s3 = tf_4_fma(TF_C4(a + i + 3 * rows), y, s3);
  }
  to[0] = tf_total(s0), to[1] = tf_total(s1), to[2] = tf_total(s2), to[3] = tf_total(s3);
}

TF_INLINE double tf_dot(int rows, const double* a, const double* b) {
  tf_lanes4 s = {0};
  for (int i = 0; i < rows; i += 4) s = tf_4_fma(TF_C4(a + i), TF_C4(b + i), s);
  return tf_total(s);
}

/* x becomes the solution of L D L^T x' = x, four rows at a time. */
TF_INLINE void tf_substitute(int rows, const double* l, const double* inverse, double* x) {
  for (int k = 0; k < rows; k += 4) {
    const double *l0 = l + k * rows, *l1 = l0 + rows, *l2 = l1 + rows, *l3 = l2 + rows;
    double x0 = x[k], x1 = fma(-l0[k + 1], x0, x[k + 1]);
    double x2 = fma(-l1[k + 2], x1, fma(-l0[k + 2], x0, x[k + 2]));
    double x3 = fma(-l2[k + 3], x2, fma(-l1[k + 3], x1, fma(-l0[k + 3], x0, x[k + 3])));
    x[k + 1] = x1, x[k + 2] = x2, x[k + 3] = x3;
    for (int i = k + 4; i < rows; i += 4) {
      const tf_lanes4 s = tf_more(tf_more(TF_4(x + i), TF_C4(l0 + i), -x0), TF_C4(l1 + i), -x1);
      TF_4(x + i) = tf_more(tf_more(s, TF_C4(l2 + i), -x2), TF_C4(l3 + i), -x3);
    }
  }
  for (int i = 0; i < rows; i += 4) TF_4(x + i) *= TF_C4(inverse + i);
  for (int k = rows - 4; k >= 0; k -= 4) {
    const double *l0 = l + k * rows, *l1 = l0 + rows, *l2 = l1 + rows;
    double s[4];
    tf_products(rows, k + 4, s, l0, x);
    double x3 = x[k + 3] - s[3], x2 = fma(-l2[k + 3], x3, x[k + 2] - s[2]);
    double x1 = fma(-l1[k + 2], x2, fma(-l1[k + 3], x3, x[k + 1] - s[1]));
    x[k] = fma(-l0[k + 1], x1, fma(-l0[k + 2], x2, fma(-l0[k + 3], x3, x[k] - s[0])));
    x[k + 1] = x1, x[k + 2] = x2, x[k + 3] = x3;
  }
}

/* to -= the sum of the columns of a, each times its number in x. */
TF_INLINE void tf_subtract(int rows, int count, double* to, const double* a, const double* x) {
  for (int i = 0; i < rows; i += 4) {
    tf_lanes4 s0 = {0}, s1 = {0}, s2 = {0}, s3 = {0};
    const double* b = a + i;
    for (int k = 0; k < count; k += 4, b += 4 * rows) {
      s0 = tf_more(s0, TF_C4(b), x[k]), s1 = tf_more(s1, TF_C4(b + rows), x[k + 1]);
      s2 = tf_more(s2, TF_C4(b + 2 * rows), x[k + 2]), s3 = tf_more(s3, TF_C4(b + 3 * rows), x[k + 3]);
    }
    TF_4(to + i) -= (s0 + s1) + (s2 + s3);
  }
}

/* The step at which the function is lowest: its slope, `rate` at 0, rises by `curve` and by the `gain`
   of each unknown from where it enters its limits to where it leaves them. */
static double tf_lowest(int n, double rate, double curve, const double* gain, const double* z,
                        const double* slope, const double* low, const double* high) {
  double enter[n], leave[n], t = 0;
  for (int k = 0; k < n; ++k) {
    double to_low = (low[k] - z[k]) / slope[k], to_high = (high[k] - z[k]) / slope[k];
    enter[k] = slope[k] > 0 ? to_low : to_high, leave[k] = slope[k] > 0 ? to_high : to_low;
  }
  for (;;) {
    tf_lanes4 rises = {0}, nexts = tf_4_all(INFINITY), now = tf_4_all(t);
    for (int k = 0; k < n; k += 4) {
      const tf_lanes4 in = TF_4(enter + k), out = TF_4(leave + k);
      rises += TF_CHOSEN((in <= now) & (now < out), TF_C4(gain + k), (tf_lanes4){0});
      nexts = TF_CHOSEN((in > now) & (in < nexts), in, nexts);
      nexts = TF_CHOSEN((out > now) & (out < nexts), out, nexts);
    }
    double rise = curve + tf_total(rises), next = nexts[0], to = t - rate / rise;
    for (int i = 1; i < 4; ++i) next = nexts[i] < next ? nexts[i] : next;
    if (!(to > next)) return to;
    rate = rise * (next - to), t = next;
  }
}

TF_INLINE void tf_bounded_least_squares(int m, int n, const double* restrict in, double* restrict out) {
  const double *b = in, *c = b + m * n, *f = c + m * m, *w = f + m, *preferred = w + n,
               *low = preferred + n, *high = low + n;
  double *q = out, *error = q + n, *y = error + m;
  double a[m * n], jacobian[m * m], u[m * m], l[m * m], inverse[m], g[m], step[m];
  double z[n], drift[n], per[n], scaled[n], slope[n], gain[n], of_y[n], moved[n];
  int all[m], chosen[n], free[n], was[n], bad = 0, ended = 0, round = 0;
  for (int j = 0; j < m; ++j) all[j] = j, y[j] = 0, bad |= !(c[j * m + j] > 0);
  for (int k = 0; k < n; ++k) {
    bad |= !(w[k] > 0 && low[k] <= high[k]);
    free[k] = low[k] < high[k], was[k] = 0, drift[k] = 0, per[k] = 1.0 / w[k];
    z[k] = preferred[k], q[k] = free[k] ? z[k] : low[k];
  }
  for (int j = 0; j < m; j += 4) { /* a is B without weights, by columns */
    const double *b0 = b + j * n, *b1 = b0 + n, *b2 = b1 + n, *b3 = b2 + n;
    for (int k = 0; k < n; ++k) TF_4(a + k * m + j) = (tf_lanes4){b0[k], b1[k], b2[k], b3[k]} * per[k];
  }
  for (; !ended && !bad && round < TF_ROUNDS; ++round) {
    int count = 0, changed = !round, same = 1;
    for (int k = 0; k < n; ++k) {
      count += free[k], changed += free[k] != was[k];
      scaled[k] = w[k] * (q[k] - drift[k]);
    }
    memcpy(g, f, sizeof g);
    tf_subtract(m, n, g, a, scaled);
    if (round) tf_subtract(m, m, g, c, y);
    if (changed) {
      int fresh = changed >= count; /* no more work than to take in what changed */
      if (fresh) memcpy(jacobian, c, sizeof jacobian), memset(was, 0, sizeof was);
      for (int sign = fresh ? 1 : -1; sign <= 1; sign += 2) {
        count = 0;
        for (int k = 0; k < n; ++k) chosen[count] = k, count += free[k] - was[k] == sign;
        for (int j = 0; count && j < m; j += 4)
          for (int i = j; i < m; i += 8) tf_tile(m, jacobian, sign, a, a, chosen, count, i, j);
      }
      memcpy(was, free, sizeof was), memcpy(u, jacobian, sizeof u);
      bad = !tf_factorize(m, u, l, inverse, all);
    }
    memcpy(step, g, sizeof step);
    tf_substitute(m, l, inverse, step);
    double along = tf_dot(m, step, g), own = 0, t = 1;
    bad |= !(fabs(along) < INFINITY);
    for (int k = 0; k < n; k += 4) {
      tf_products(m, 0, slope + k, a + k * m, step);
      TF_4(slope + k) = TF_4(slope + k) * TF_4(per + k) - TF_4(drift + k);
    }
    for (int k = 0; k < n; ++k) {
      double kept = tf_clipped(z[k] + slope[k], low[k], high[k]);
      double next = free[k] ? z[k] + slope[k] : q[k], weighted = w[k] * slope[k];
      same &= fabs(next - kept) <= 1e-13 * (fabs(next) + fabs(kept));
      gain[k] = weighted * weighted;
    }
    for (int k = 0; k < n; ++k) own += free[k] ? gain[k] : 0;
    ended = same && (!changed || (!round && along <= TF_FAR * own));
    if (round && !same) {
      memset(error, 0, m * sizeof *error);
      tf_subtract(m, m, error, c, step);
      t = tf_lowest(n, -along, -tf_dot(m, step, error), gain, z, slope, low, high);
    }
    for (int j = 0; j < m; j += 4) TF_4(y + j) += t * TF_4(step + j);
    for (int k = 0; k < n; k += 4) {
      tf_products(m, 0, of_y + k, a + k * m, y);
      TF_4(of_y + k) = TF_C4(preferred + k) + TF_4(of_y + k) * TF_4(per + k);
      TF_4(moved + k) = TF_4(z + k) + t * TF_4(slope + k);
    }
    for (int k = 0; k < n; ++k) {
      z[k] = free[k] ? moved[k] : of_y[k];
      q[k] = tf_clipped(z[k], low[k], high[k]);
      free[k] = z[k] > low[k] && z[k] < high[k];
      drift[k] = free[k] ? z[k] - of_y[k] : 0;
    }
  }
  for (int k = 0; k < n; ++k) scaled[k] = w[k] * q[k];
  memcpy(error, f, m * sizeof *f);
  tf_subtract(m, n, error, a, scaled);
  for (int k = 0; bad && k < n + 2 * m; ++k) out[k] = NAN;
}
#endif
