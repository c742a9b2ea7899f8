/* The fixed steps in C, for simulations (driver.c) and native FMUs. Their twins in Python are the formulas of
   `FIXED_STEP` in blocks/simulation/solver.py: what changes here changes there. TF_X, the number of
   continuous states, is defined before. */

#include <math.h>
#include <string.h>

#ifndef TF_NUMBER /* a vector where several runs are advanced at once, one in each lane */
#define TF_NUMBER double
#endif
typedef TF_NUMBER tf_number;

/* Every program of a plan is a function (t, x, d, p, result). */
typedef void (*tf_program)(const double*, const tf_number*, const tf_number*, const tf_number*, tf_number*);

enum { TF_RK4, TF_EULER, TF_DENSE }; /* the solvers, in the order of FIXED_STEP; within a variable step */

typedef struct {
  tf_number stage[TF_X + 1], sum[TF_X + 1], rate[TF_X + 1], next[TF_X + 1];
#ifdef TF_VARIABLE
  struct tf_variable* variable; /* the last step of variable length, see variable_step.h */
#endif
} tf_steps;

static inline int tf_finite(const tf_number* v, int n) {
  const double* each = (const double*)v; /* vectors may be read so */
  int finite = 1; /* no sum: each addition would wait for the one before */
  for (int i = 0; i < n * (int)(sizeof *v / sizeof *each); ++i) finite &= each[i] * 0.0 == 0.0;
  return finite;
}

/* The number just below t, as nextafter(t, -INFINITY) gives it, but without libm, which not every
   build of an FMU's sources links. Doubles of one sign are ordered like their bits, so the side of
   zero matters: a factor 1 - 2^-53 would move a negative time forward, and leave zero at zero. */
static inline double tf_just_before(double t) {
  long long bits;
  if (t == 0.0) return -0x1p-1074;
  memcpy(&bits, &t, sizeof bits);
  bits += t > 0.0 ? -1 : 1;
  memcpy(&t, &bits, sizeof bits);
  return t;
}

/* One step of the classical fourth-order Runge-Kutta method from t to `end`, from x to s->next.
   The last stage is just before `end`: a signal that jumps there belongs to the step after. */
static inline void tf_rk4(tf_program f, tf_steps* restrict s, double t, double end, double h,
                          const tf_number* restrict x, const tf_number* d, const tf_number* p) {
  double middle = t + 0.5 * h, last = tf_just_before(end);
  tf_number* k = s->rate;
  f(&t, x, d, p, k);
  for (int i = 0; i < TF_X; ++i) s->sum[i] = x[i] + h / 6 * k[i], s->stage[i] = x[i] + h / 2 * k[i];
  f(&middle, s->stage, d, p, k);
  for (int i = 0; i < TF_X; ++i) s->sum[i] += h / 3 * k[i], s->stage[i] = x[i] + h / 2 * k[i];
  f(&middle, s->stage, d, p, k);
  for (int i = 0; i < TF_X; ++i) s->sum[i] += h / 3 * k[i], s->stage[i] = x[i] + h * k[i];
  f(&last, s->stage, d, p, k);
  for (int i = 0; i < TF_X; ++i) s->next[i] = s->sum[i] + h / 6 * k[i];
}

/* One step of Euler's method, likewise. */
static inline void tf_euler(tf_program f, tf_steps* restrict s, double t, double h,
                            const tf_number* restrict x, const tf_number* d, const tf_number* p) {
  f(&t, x, d, p, s->rate);
  for (int i = 0; i < TF_X; ++i) s->next[i] = x[i] + h * s->rate[i];
}
