/* Newton's method for the algebraic loops of a program: the twin of newton.py, which says what is computed
   and why it ends. What changes here changes there. */

#ifndef TF_NEWTON
#define TF_NEWTON
#include <string.h>

#define TF_NEWTON_ROUNDS 60 /* as in newton.py */
#define TF_NEWTON_NOISE 4e-15

/* The residual at z and its derivatives by z, row by row; s is what they depend on besides. */
typedef void (*tf_loop)(const double* z, const double* s, double* residual, double* slope);

/* v becomes the solution of a x = v, by elimination with row exchanges, and terms how large those of a z
   are; 0 if a is as good as singular. */
static int tf_eliminate(int n, double* a, double* v, const double* z, double* terms) {
  double m[n * n], weight[n];
  for (int i = 0; i < n * n; ++i) m[i] = i % (n + 1) ? fabs(a[i]) : 1.0 + fabs(a[i] + 1.0);
  for (int i = 0; i < n; ++i) {
    terms[i] = weight[i] = 0.0;
    for (int j = 0; j < n; ++j) terms[i] += m[i * n + j] * fabs(z[j]);
  }
  for (int j = 0; j < n; ++j) {
    double column = 0.0;
    for (int i = 0; i < n; ++i) column = fmax(column, m[i * n + j]);
    for (int i = 0; i < n; ++i) weight[i] = fmax(weight[i], m[i * n + j] / column);
  }
  for (int k = 0; k < n; ++k) {
    int best = k;
    for (int i = k + 1; i < n; ++i)
      if (fabs(a[i * n + k]) / weight[i] > fabs(a[best * n + k]) / weight[best]) best = i;
    double *row = a + k * n, *other = a + best * n, *its = m + k * n, *others = m + best * n, kept = v[k];
    v[k] = v[best], v[best] = kept;
    kept = weight[k], weight[k] = weight[best], weight[best] = kept;
    for (int j = k; j < n; ++j) {
      kept = row[j], row[j] = other[j], other[j] = kept;
      kept = its[j], its[j] = others[j], others[j] = kept;
    }
    if (!(fabs(row[k]) > TF_NEWTON_NOISE * n * its[k])) return 0;
    for (int i = k + 1; i < n; ++i) {
      double factor = a[i * n + k] / row[k];
      for (int j = k; j < n; ++j) {
        a[i * n + j] -= factor * row[j];
        m[i * n + j] += fabs(factor * row[j]);
      }
      v[i] -= factor * v[k];
    }
  }
  for (int k = n - 1; k >= 0; --k) {
    for (int j = k + 1; j < n; ++j) v[k] -= a[k * n + j] * v[j];
    v[k] /= a[k * n + k];
  }
  return 1;
}

/* Compute the residual at z, the step from there, and how large the terms of the residual are; the first
   element of the step is NaN if there is none. */
static void tf_newton_step(int n, tf_loop loop, const double* z, const double* s, double* residual,
                           double* step, double* terms) {
  double slope[n * n];
  loop(z, s, residual, slope);
  memcpy(step, residual, n * sizeof *step);
  if (!tf_eliminate(n, slope, step, z, terms)) step[0] = NAN;
}

/* How large a residual is, each element by a unit of its own. */
static double tf_squares(int n, const double* residual, const double* unit) {
  double sum = 0.0;
  for (int i = 0; i < n; ++i) sum += (residual[i] / unit[i]) * (residual[i] / unit[i]);
  return sum;
}

/* in: where to start, then s. */
static void tf_newton(int n, tf_loop loop, const double* in, double* z) {
  const double* s = in + n;
  double step[n], residual[n], unit[n], from[n], whole[n], terms[n], last[n], left;
  int solved = 0, ended = 0;
  memcpy(z, in, n * sizeof *z);
  memset(last, 0, sizeof last);
  tf_newton_step(n, loop, z, s, residual, step, terms);
  for (int round = 0; round < TF_NEWTON_ROUNDS && !ended; ++round) {
    int close = 1, rough = 1;
    for (int i = 0; i < n; ++i) {
      double moved = fabs(step[i]), size = fabs(z[i]);
      close &= moved <= 1e-12 * size;
      rough &= moved <= 1e-10 * (size + last[i]) + 1e-13 * terms[i];
      unit[i] = terms[i] + moved > 0.0 ? terms[i] + moved : 1.0;
    }
    left = tf_squares(n, residual, unit);
    memcpy(from, z, sizeof from), memcpy(whole, step, sizeof whole);
    for (double part = 1.0;; part /= 2) {
      for (int i = 0; i < n; ++i) z[i] = from[i] - part * whole[i];
      tf_newton_step(n, loop, z, s, residual, step, terms);
      double now = tf_squares(n, residual, unit);
      if (now < left) {
        left = now;
        for (int i = 0; i < n; ++i) last[i] = part * fabs(whole[i]);
        break;
      }
      if (rough || !(part > 1e-9)) {
        memcpy(z, from, sizeof from), memcpy(step, whole, sizeof whole);
        ended = 1;
        break;
      }
    }
    solved = rough || left == 0.0;
    ended |= close || left == 0.0;
  }
  for (int i = 0; i < n; ++i) solved &= fabs(step[i]) < INFINITY;
  for (int i = 0; i < n && !solved; ++i) z[i] = NAN;
}
#endif
