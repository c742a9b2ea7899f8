/* Steps of variable length in C, for simulations: explicit Runge-Kutta methods and a Rosenbrock method with a
   sparse factorization. The twin in Python is blocks/simulation/adaptive.py: a change here needs one there.
   This file follows fixed_step.h. TF_METHODS (tables of coefficients, see tableaus.py), TF_ROWS and
   TF_DENSE_ROWS (most rows of increments and of the dense output) are defined before; with TF_STIFF also the
   tables of the Jacobian, see variable_step.py. */

typedef struct {
  int stages, rows, width, dense_rows, dense_width, order;
  double limit, gamma;
  const double *a, *c, *error, *dense, *coupling, *slope;
} tf_tableau;

/* Settings and state of a run with variable steps. `Control` in adaptive.py has the same fields. */
typedef struct {
  double t, end, h, rtol, atol, short_step, failed, switched;
  long long max_steps, due_rows, room, rows, steps, rejected, evaluations, factorizations, short_steps;
  int method, automatic, begun, stepped, limited_steps, other_steps;
} tf_control;

struct tf_variable {
  tf_control* control;
  const tf_tableau* method;
  tf_program derivative, tangent;
  const double *x, *d, *p; /* state at the begin of the step, and data of the run */
  double h, now, last;     /* length and end of the step, and latest time of a stage */
  int has_slope, has_jacobian, has_dense, event; /* has_dense: number of rows */
  double k[TF_ROWS][TF_X + 1], dense[TF_DENSE_ROWS][TF_X + 1];
  double stage[TF_X + 1], slope[TF_X + 1], next[TF_X + 1]; /* `stage`: also the point that failed */
#if TF_STIFF
  double jacobian[2 * TF_FILL + 2 * TF_X], factors[2 * TF_FILL + TF_X], column[TF_X], row[TF_X];
  double seeded[2 * TF_X + 1], result[TF_X];
#endif
};
typedef struct tf_variable tf_variable;

static const tf_tableau tf_tableaus[] = {TF_METHODS};
static const double tf_zeros[TF_X + 1];

static double tf_larger(double a, double b) { return a > b ? a : b; }

#define TF_BLOCK (TF_X < 64 ? TF_X + 1 : 64)

/* point = x + scale * sum of a[j] * k[j], j < count; in blocks of states, as the stack of a thread is small */
static void tf_combine(const double* x, double scale, const double* a, int count, double (*k)[TF_X + 1],
                       double* point) {
  for (int begin = 0; begin < TF_X; begin += TF_BLOCK) {
    const int size = TF_X - begin < TF_BLOCK ? TF_X - begin : TF_BLOCK;
    double sum[TF_BLOCK];
    memset(sum, 0, sizeof sum);
    for (int j = 0; j < count; ++j)
      if (a[j] != 0.0)
        for (int i = 0; i < size; ++i) sum[i] += a[j] * k[j][begin + i];
    for (int i = 0; i < size; ++i) point[begin + i] = x[begin + i] + scale * sum[i];
  }
}

/* Compute the derivative; false if it is not finite. */
static int tf_rate(tf_variable* v, double t, const double* x, double* rate) {
  if (t > v->last) t = v->last; /* a signal that jumps at the end of the span has not jumped yet */
  v->derivative(&t, x, v->d, v->p, rate);
  ++v->control->evaluations;
  if (tf_finite(rate, TF_X)) return 1;
  v->control->failed = t;
  if (x != v->stage) memcpy(v->stage, x, TF_X * sizeof *x);
  return 0;
}

static double tf_scale(const tf_variable* v, int i, const double* x) {
  return v->control->atol + v->control->rtol * tf_larger(fabs(v->x[i]), fabs(x[i]));
}

/* Root of the mean square of values relative to the tolerance. */
static double tf_norm(const tf_variable* v, const double* values, const double* minus) {
  double sum = 0.0;
  for (int i = 0; i < TF_X; ++i) {
    double one = (values[i] - (minus ? minus[i] : 0.0)) / tf_scale(v, i, v->x);
    sum += one * one;
  }
  return sqrt(sum / TF_X);
}

/* First step after a start, by the curvature (Hairer, Norsett, Wanner, Solving ODEs I, section II.4). */
static double tf_first_step(tf_variable* v, double t, double longest) {
  double state = tf_norm(v, v->x, 0), rate = tf_norm(v, v->slope, 0), h = 1e-6, bend, most;
  if (state >= 1e-5 && rate >= 1e-5) h = 0.01 * state / rate;
  if (h > longest) h = longest;
  for (int i = 0; i < TF_X; ++i) v->stage[i] = v->x[i] + h * v->slope[i];
  if (!tf_rate(v, t + h, v->stage, v->next)) return h;
  bend = tf_norm(v, v->next, v->slope) / h;
  most = tf_larger(rate, bend);
  most = most <= 1e-15 ? tf_larger(1e-6, h * 1e-3) : pow(0.01 / most, 1.0 / v->method->order);
  if (most > 100 * h) most = 100 * h;
  return most < longest ? most : longest;
}

/* Compute the increments and the next state; false if a derivative is not finite. */
static int tf_explicit(tf_variable* v, double t, double h) {
  const tf_tableau* b = v->method;
  memcpy(v->k[0], v->slope, TF_X * sizeof(double));
  for (int i = 1; i <= b->stages; ++i) {
    double* point = i < b->stages ? v->stage : v->next;
    tf_combine(v->x, h, b->a + i * b->width, i, v->k, point);
    if (!tf_rate(v, t + b->c[i] * h, point, v->k[i])) return 0;
  }
  return 1;
}

#if TF_STIFF
#define TF_SOLVED 1e-8 /* largest residual of linear equations, relative to their terms */

/* Compute the Jacobian and the derivative by time: columns of one colour have no row in common. */
static void tf_linearize(tf_variable* v, double t) {
  if (t > v->last) t = v->last;
  memcpy(v->seeded, v->x, TF_X * sizeof(double));
  for (int c = 0; c < TF_COLORS; ++c) {
    memset(v->seeded + TF_X, 0, (TF_X + 1) * sizeof(double));
    for (int i = tf_seeds_begin[c]; i < tf_seeds_begin[c + 1]; ++i) v->seeded[TF_X + tf_seeds[i]] = 1.0;
    v->tangent(&t, v->seeded, v->d, v->p, v->result);
    for (int i = tf_entries_begin[c]; i < tf_entries_begin[c + 1]; ++i)
      v->jacobian[tf_entry_places[i]] = v->result[tf_entry_rows[i]];
  }
}

/* Factorize W = shift I - J without exchanges: rows of L and columns of U have one pattern. The arrays hold
   the columns of U, the rows of L and the diagonal, which is inverted here. */
static void tf_factorize(tf_variable* v, double shift) {
  double *u = v->factors, *l = u + TF_FILL, *inverse = l + TF_FILL, *a = v->column, *b = v->row;
  for (int i = 0; i < 2 * TF_FILL; ++i) u[i] = -v->jacobian[i];
  for (int j = 0; j < TF_X; ++j) {
    double diagonal = shift - v->jacobian[2 * TF_FILL + j];
    int begin = tf_fill_begin[j], end = tf_fill_begin[j + 1];
    for (int e = begin; e < end; ++e) a[tf_fill[e]] = u[e], b[tf_fill[e]] = l[e];
    for (int e = begin; e < end; ++e) {
      int k = tf_fill[e];
      double above = a[k], left = b[k];
      for (int f = tf_fill_begin[k]; f < tf_fill_begin[k + 1]; ++f) {
        above -= l[f] * a[tf_fill[f]];
        left -= u[f] * b[tf_fill[f]];
      }
      a[k] = above, b[k] = left * inverse[k];
      diagonal -= a[k] * b[k];
    }
    for (int e = begin; e < end; ++e) {
      u[e] = a[tf_fill[e]], l[e] = b[tf_fill[e]];
      a[tf_fill[e]] = b[tf_fill[e]] = 0.0;
    }
    inverse[j] = 1.0 / diagonal;
  }
  ++v->control->factorizations;
}

static void tf_solve(tf_variable* v, double* r) {
  const double *u = v->factors, *l = u + TF_FILL, *inverse = l + TF_FILL;
  double* y = v->result;
  for (int j = 0; j < TF_X; ++j) {
    double sum = r[tf_order[j]];
    for (int e = tf_fill_begin[j]; e < tf_fill_begin[j + 1]; ++e) sum -= l[e] * y[tf_fill[e]];
    y[j] = sum;
  }
  for (int j = TF_X - 1; j >= 0; --j) {
    y[j] *= inverse[j];
    for (int e = tf_fill_begin[j]; e < tf_fill_begin[j + 1]; ++e) y[tf_fill[e]] -= u[e] * y[j];
    r[tf_order[j]] = y[j];
  }
}

/* Whether the solution k of W k = r is exact but for round-off. A small pivot, which elimination without
   exchanges may meet, makes it inaccurate; a shorter step has another pivot. */
static int tf_solved(tf_variable* v, double shift, const double* k, const double* r) {
  const double *u = v->jacobian, *l = u + TF_FILL, *diagonal = l + TF_FILL;
  double *left = v->seeded, *size = left + TF_X; /* of the residual and of its terms */
  for (int j = 0; j < TF_X; ++j) {
    double one = (shift - diagonal[j]) * k[tf_order[j]], other = r[tf_order[j]];
    left[j] = other - one, size[j] = fabs(one) + fabs(other);
    for (int e = tf_fill_begin[j]; e < tf_fill_begin[j + 1]; ++e) {
      int i = tf_fill[e];
      one = l[e] * k[tf_order[i]], other = u[e] * k[tf_order[j]];
      left[j] += one, size[j] += fabs(one);
      left[i] += other, size[i] += fabs(other);
    }
  }
  int good = 1;
  for (int j = 0; j < TF_X; ++j) good &= fabs(left[j]) <= TF_SOLVED * size[j];
  return good;
}

/* Compute the increments and the next state of a Rosenbrock method: W k_i = f_i + sum of c_ij k_j / h +
   g_i h df/dt (Hairer, Wanner, Solving ODEs II, section IV.7). */
static int tf_rosenbrock(tf_variable* v, double t, double h) {
  const tf_tableau* b = v->method;
  const double shift = 1.0 / (h * b->gamma), *by_time = v->jacobian + 2 * TF_FILL + TF_X;
  double *r = v->next, *point = v->stage; /* not on the stack, which is small */
  if (!v->has_jacobian) tf_linearize(v, t), v->has_jacobian = 1;
  tf_factorize(v, shift);
  for (int i = 0; i < b->stages; ++i) {
    memcpy(r, v->slope, TF_X * sizeof *r);
    if (i) {
      tf_combine(v->x, 1.0, b->a + i * b->width, i, v->k, point);
      if (!tf_rate(v, t + b->c[i] * h, point, r)) return 0;
    }
    tf_combine(r, 1.0 / h, b->coupling + i * b->width, i, v->k, v->k[i]);
    for (int j = 0; j < TF_X; ++j) v->k[i][j] += b->slope[i] * h * by_time[j];
    memcpy(r, v->k[i], TF_X * sizeof *r);
    tf_solve(v, v->k[i]);
    if (!i && !tf_solved(v, shift, v->k[i], r)) return 0;
  }
  tf_combine(v->x, 1.0, b->a + b->stages * b->width, b->stages, v->k, v->next);
  return 1;
}
#endif

/* Error of the step, relative to the tolerance. */
static double tf_error(const tf_variable* v, double h) {
  const tf_tableau* b = v->method;
  const double *first = b->error, *second = first + b->stages + 1;
  double sum = 0.0, other = 0.0;
  for (int i = 0; i < TF_X; ++i) {
    double one = 0.0, two = 0.0, scale = tf_scale(v, i, v->next);
    for (int j = 0; j <= b->stages; ++j) {
      if (first[j] != 0.0) one += first[j] * v->k[j][i];
      if (second[j] != 0.0) two += second[j] * v->k[j][i];
    }
    one /= scale, two /= scale;
    sum += one * one, other += two * two;
  }
  other = sum + 0.01 * other;
  if (other == 0.0) return 0.0;
  return (b->gamma != 0.0 ? 1.0 : h) * sum / sqrt(other * TF_X);
}

/* Whether stability limits the steps of an explicit method: so says the change of the derivative between two
   points at the end of the step, 15 times with less than 6 others in between (Hairer, Wanner, section IV.2). */
static int tf_stiff(tf_variable* v) {
  const tf_tableau* b = v->method;
  tf_control* c = v->control;
  double above = 0.0, below = 0.0;
  for (int i = 0; i < TF_X; ++i) {
    double rate = v->k[b->stages][i] - v->k[b->stages - 1][i], moved = v->next[i] - v->stage[i];
    above += rate * rate, below += moved * moved;
  }
  if (below > 0.0 && v->h * sqrt(above / below) > b->limit)
    c->other_steps = 0, ++c->limited_steps;
  else if (c->limited_steps && ++c->other_steps == 6)
    c->limited_steps = 0;
  return c->limited_steps == 15;
}

/* Take one step from x, at most up to `stop`; false if there is none. */
static int tf_step(tf_variable* v, double stop) {
  tf_control* c = v->control;
  const double smallest = tf_larger(10 * 2.220446049250313e-16 * fabs(c->t), 1e-300);
  int rejected = 0;
  v->method = tf_tableaus + c->method;
  c->failed = NAN;
  v->has_dense = 0;
  if (stop <= c->t) { /* a time event that is due already */
    v->now = c->t, v->h = 0.0;
    memcpy(v->next, v->x, TF_X * sizeof *v->x);
    return 1;
  }
  if (!v->has_slope) {
    if (!tf_rate(v, c->t, v->x, v->slope)) return 0;
    v->has_slope = 1, v->has_jacobian = 0;
  }
  if (c->h == 0.0) c->h = tf_first_step(v, c->t, stop - c->t);
  for (;;) {
    double h = c->h, error = NAN;
    if (h < smallest) {
      if (rejected) return 0;
      h = smallest;
    }
    v->now = c->t + h;
    if (v->now >= stop) v->now = stop, h = stop - c->t;
    c->failed = NAN;
#if TF_STIFF
    if (v->method->gamma != 0.0) {
      if (tf_rosenbrock(v, c->t, h)) error = tf_error(v, h);
    } else
#endif
        if (tf_explicit(v, c->t, h))
      error = tf_error(v, h);
    double factor = error == 0.0 ? 10.0 : 0.9 * pow(error, -1.0 / v->method->order);
    if (error < 1.0 && tf_finite(v->next, TF_X)) {
      if (factor > 10.0) factor = 10.0;
      c->h = h * (rejected && factor > 1.0 ? 1.0 : factor);
      v->h = h;
      ++c->steps;
      c->short_steps = h < c->short_step ? c->short_steps + 1 : 0;
      return 1;
    }
    ++c->rejected, rejected = 1;
    c->h = h * (factor > 0.2 && factor < 1.0 ? factor : 0.2);
  }
}

/* Prepare the dense output of the last step. */
static void tf_make_dense(tf_variable* v) {
  const tf_tableau* b = v->method;
  const double t = v->control->t, h = v->h, scale = b->gamma != 0.0 ? 1.0 : h, *a = b->dense;
  int row = 1;
  for (int i = b->stages + 1; i < b->rows; ++i) {
    tf_combine(v->x, h, b->a + i * b->width, i, v->k, v->stage);
    tf_rate(v, t + b->c[i] * h, v->stage, v->k[i]);
  }
  for (int i = 0; i < TF_X; ++i) v->dense[0][i] = v->next[i] - v->x[i];
  if (b->gamma == 0.0) {
    row = 3;
    for (int i = 0; i < TF_X; ++i) {
      v->dense[1][i] = h * v->k[0][i] - v->dense[0][i];
      v->dense[2][i] = v->dense[0][i] - h * v->k[b->stages][i] - v->dense[1][i];
    }
  }
  for (int i = 0; i < b->dense_rows; ++i, a += b->dense_width)
    tf_combine(tf_zeros, scale, a, b->dense_width, v->k, v->dense[row + i]);
  v->has_dense = row + b->dense_rows;
}

/* State at a time within the last step. */
static void tf_interpolate(tf_variable* v, double t, double* state) {
  if (!v->has_dense) tf_make_dense(v);
  double part = (t - v->control->t) / v->h, rest = 1.0 - part;
  for (int i = 0; i < TF_X; ++i) {
    double sum = 0.0;
    for (int j = v->has_dense - 1; j >= 0; --j) sum = (sum + v->dense[j][i]) * (j % 2 ? rest : part);
    state[i] = v->x[i] + sum;
  }
}
