/* Directional and adjoint derivatives by algorithmic differentiation. The tape is the sequence of
   operations of derivatives and outputs. One run per point gives the partial derivatives of every
   operation; each direction then needs one pass of products and sums. */

typedef struct {
  unsigned length;
  const unsigned char* operation;
  const unsigned *a, *b; /* operands; for an input or a constant, a is its index */
  const double* constants;
  const unsigned* rows; /* operations that compute the results */
} tf_tape;

/* Run a tape at z: compute the value v and the partial derivatives pa, pb of each operation. */
static void tf_run_tape(const tf_tape* tape, unsigned length, const double* z, double* v,
                        double* pa, double* pb) {
  for (unsigned i = 0; i < length; ++i) {
    unsigned ia = tape->a[i];
    double f = 0, da = 0, db = 0;
    if (tape->operation[i] == TF_OP_INPUT) {
      f = z[ia];
    } else if (tape->operation[i] == TF_OP_CONST) {
      f = tape->constants[ia];
    } else {
      double x = v[ia], y = v[tape->b[i]];
      switch (tape->operation[i]) {
        case TF_OP_ASSIGN: f = x, da = 1; break;
        case TF_OP_ADD: f = x + y, da = db = 1; break;
        case TF_OP_SUB: f = x - y, da = 1, db = -1; break;
        case TF_OP_MUL: f = x * y, da = y, db = x; break;
        case TF_OP_DIV: f = x / y, da = 1 / y, db = -f / y; break;
        case TF_OP_NEG: f = -x, da = -1; break;
        case TF_OP_SQ: f = x * x, da = 2 * x; break;
        case TF_OP_TWICE: f = 2 * x, da = 2; break;
        case TF_OP_INV: f = 1 / x, da = -f * f; break;
        case TF_OP_SQRT: f = sqrt(x), da = 0.5 / f; break;
        case TF_OP_EXP: f = da = exp(x); break;
        case TF_OP_LOG: f = log(x), da = 1 / x; break;
        case TF_OP_POW: f = pow(x, y), da = y * pow(x, y - 1), db = f == 0 ? 0 : log(x) * f; break;
        case TF_OP_CONSTPOW: f = pow(x, y), da = y * pow(x, y - 1); break;
        case TF_OP_SIN: f = sin(x), da = cos(x); break;
        case TF_OP_COS: f = cos(x), da = -sin(x); break;
        case TF_OP_TAN: f = tan(x), da = 1 + f * f; break;
        case TF_OP_ASIN: f = asin(x), da = 1 / sqrt(1 - x * x); break;
        case TF_OP_ACOS: f = acos(x), da = -1 / sqrt(1 - x * x); break;
        case TF_OP_ATAN: f = atan(x), da = 1 / (1 + x * x); break;
        case TF_OP_ATAN2: f = atan2(x, y), da = y / (x * x + y * y), db = -x / (x * x + y * y); break;
        case TF_OP_SINH: f = sinh(x), da = cosh(x); break;
        case TF_OP_COSH: f = cosh(x), da = sinh(x); break;
        case TF_OP_TANH: f = tanh(x), da = 1 - f * f; break;
        case TF_OP_ASINH: f = asinh(x), da = 1 / sqrt(1 + x * x); break;
        case TF_OP_ACOSH: f = acosh(x), da = 1 / sqrt(x * x - 1); break;
        case TF_OP_ATANH: f = atanh(x), da = 1 / (1 - x * x); break;
        case TF_OP_ERF: f = erf(x), da = 1.1283791670955126 * exp(-x * x); break;
        case TF_OP_LOG1P: f = log1p(x), da = 1 / (1 + x); break;
        case TF_OP_EXPM1: f = expm1(x), da = exp(x); break;
        case TF_OP_HYPOT: f = sqrt(x * x + y * y), da = x / f, db = y / f; break;
        case TF_OP_FABS: f = fabs(x), da = (x > 0) - (x < 0); break;
        case TF_OP_SIGN: f = x < 0 ? -1 : x > 0 ? 1 : x; break;
        case TF_OP_COPYSIGN: f = copysign(x, y), da = (signbit(x) == signbit(y)) ? 1 : -1; break;
        case TF_OP_FMIN: da = x < y || x != x, db = !da, f = da ? x : y; break;
        case TF_OP_FMAX: da = x > y || x != x, db = !da, f = da ? x : y; break;
        case TF_OP_FMOD: f = fmod(x, y), da = 1, db = -trunc(x / y); break;
        case TF_OP_REMAINDER: f = remainder(x, y), da = 1, db = -nearbyint((x - f) / y); break;
        case TF_OP_FLOOR: f = floor(x); break;
        case TF_OP_CEIL: f = ceil(x); break;
        case TF_OP_LT: f = x < y; break;
        case TF_OP_LE: f = x <= y; break;
        case TF_OP_EQ: f = x == y; break;
        case TF_OP_NE: f = x != y; break;
        case TF_OP_NOT: f = !x; break;
        case TF_OP_AND: f = x && y; break;
        case TF_OP_OR: f = x || y; break;
        case TF_OP_IF_ELSE_ZERO: f = x != 0 ? y : 0, db = x != 0; break;
      }
    }
    v[i] = f, pa[i] = da, pb[i] = db;
  }
}

/* A partial derivative may be infinite in an inactive branch, so a zero factor gives 0, not NaN. */
static double tf_term(double partial, double seed) {
  return partial == 0 || seed == 0 ? 0 : partial * seed;
}

static void tf_along(const tf_tape* tape, unsigned length, const double* seed, const double* pa,
                     const double* pb, double* w) {
  for (unsigned i = 0; i < length; ++i)
    w[i] = tape->operation[i] == TF_OP_INPUT
               ? seed[tape->a[i]]
               : tape->operation[i] == TF_OP_CONST
                     ? 0
                     : tf_term(pa[i], w[tape->a[i]]) + tf_term(pb[i], w[tape->b[i]]);
}

/* Reverse pass: w has the seeds of the results, `seed` receives those of the inputs. */
static void tf_back(const tf_tape* tape, unsigned length, double* seed, const double* pa,
                    const double* pb, double* w) {
  for (unsigned i = length; i-- > 0;) {
    if (w[i] == 0 || tape->operation[i] == TF_OP_CONST) continue;
    if (tape->operation[i] == TF_OP_INPUT) {
      seed[tape->a[i]] += w[i];
    } else {
      w[tape->a[i]] += tf_term(pa[i], w[i]);
      w[tape->b[i]] += tf_term(pb[i], w[i]);
    }
  }
}

/* Inputs of the tapes: time, states, discrete values and inputs, parameters. */
enum { TF_Z_X = 1, TF_Z_D = 1 + TF_X, TF_Z_U = TF_Z_D + TF_D - TF_U, TF_Z_P = TF_Z_D + TF_D,
       TF_Z = TF_Z_P + TF_P };

static const tf_tape tf_running = {TF_TAPE, tf_tape_operation, tf_tape_a, tf_tape_b,
                                   tf_tape_constants, tf_tape_rows};
static const tf_tape tf_starting = {TF_TAPE0, tf_tape0_operation, tf_tape0_a, tf_tape0_b,
                                    tf_tape0_constants, tf_tape0_rows};

/* Work space: for each tape values, two partial derivatives and a direction, then seeds. */
#define TF_LINEAR (4 * ((size_t)TF_TAPE + TF_TAPE0) + 2 * (size_t)TF_Z + TF_X + TF_M + 1)

static unsigned tf_place(unsigned reference) {
  if (reference >= TF_VR_X) return TF_Z_X + reference - TF_VR_X;
  if (reference >= TF_VR_P) return TF_Z_P + reference - TF_VR_P;
  return reference == TF_VR_TIME ? 0 : TF_Z_U + reference - TF_VR_U;
}

/* Run the tapes at the current point. */
static tf_status tf_prepare(tf_instance* c, int outputs) {
  const tf_model m = TF_MODEL_OF(TF_OWN, tf_kinds, TF_SIDES);
  unsigned length = outputs ? TF_TAPE : TF_TAPE_RATES;
  if (!c->linear) c->linear = malloc(TF_LINEAR * sizeof(double));
  if (!c->linear) return tf_refuse(c, TF_ERROR, "out of memory");
  if (c->linear_known > outputs) return TF_OK;
  double *v = c->linear, *v0 = v + 4 * (size_t)TF_TAPE, *z = v0 + 4 * (size_t)TF_TAPE0;
  int initial = c->s.phase == TF_INITIALIZATION;
  z[0] = tf_now(c);
  memcpy(z + TF_Z_X, c->s.x, TF_X * sizeof(double));
  memcpy(z + TF_Z_D, c->s.d, TF_D * sizeof(double));
  memcpy(z + TF_Z_P, c->s.p, TF_P * sizeof(double));
  if (initial) {
    tf_run_tape(&tf_starting, TF_TAPE0, z, v0, v0 + TF_TAPE0, v0 + 2 * (size_t)TF_TAPE0);
    tf_initialize(c);
    memcpy(z + TF_Z_X, c->s.x, TF_X * sizeof(double));
  }
  memcpy(z + TF_Z_D, tf_d(c), TF_D * sizeof(double));
  tf_keep(&m, z[0], c->s.x, z + TF_Z_D, c->s.p); /* the tape needs the solution of the loops as start values */
  tf_run_tape(&tf_running, length, z, v, v + TF_TAPE, v + 2 * (size_t)TF_TAPE);
  c->linear_known = 1 + outputs;
  return TF_OK;
}

/* Check unknowns and knowns; set *outputs to whether any unknown is an output. */
static tf_status tf_check_sides(tf_instance* c, const unsigned* unknown, size_t nu,
                                const unsigned* known, size_t nk, int* outputs) {
  int initial = c->s.phase == TF_INITIALIZATION;
  *outputs = 0;
  for (size_t i = 0; i < nu; ++i) {
    unsigned r = unknown[i];
    int state = initial && r >= TF_VR_X && r < TF_VR_DX && !tf_x_exact[r - TF_VR_X];
    if (r >= TF_VR_MODES || (r < TF_VR_DX && !state))
      return tf_refuse(c, TF_ERROR, "value reference %u is no unknown of a derivative", r);
    *outputs |= r >= TF_VR_Y;
  }
  for (size_t i = 0; i < nk; ++i) {
    unsigned r = known[i];
    int free = (r && r < TF_VR_X) || (r < TF_VR_DX && !(initial && !tf_x_exact[r - TF_VR_X]));
    if (!free) return tf_refuse(c, TF_ERROR, "value reference %u is no known of a derivative", r);
  }
  return TF_OK;
}

static tf_status tf_sloped(tf_instance* c, const double* result, size_t n) {
  if (tf_finite(result, (int)n)) return TF_OK;
  return tf_refuse(c, TF_DISCARD, "a partial derivative is not finite at %.9g", c->s.time);
}

/* Return the index of an unknown in the results of the tf_running tape. */
static unsigned tf_row(unsigned reference) { return tf_tape_rows[reference - TF_VR_DX]; }

static tf_status tf_directional(tf_instance* c, const unsigned* unknown, size_t nu,
                                const unsigned* known, size_t nk, const double* seed,
                                double* result) {
  int outputs, initial = c->s.phase == TF_INITIALIZATION;
  tf_status status = tf_check_sides(c, unknown, nu, known, nk, &outputs);
  if (status == TF_OK) status = tf_prepare(c, outputs);
  if (status != TF_OK) return status;
  double *v = c->linear, *v0 = v + 4 * (size_t)TF_TAPE, *s = v0 + 4 * (size_t)TF_TAPE0 + TF_Z;
  double *w = v + 3 * (size_t)TF_TAPE, *w0 = v0 + 3 * (size_t)TF_TAPE0;
  memset(s, 0, TF_Z * sizeof(double));
  for (size_t i = 0; i < nk; ++i) s[tf_place(known[i])] += seed[i];
  if (initial) {
    tf_along(&tf_starting, TF_TAPE0, s, v0 + TF_TAPE0, v0 + 2 * (size_t)TF_TAPE0, w0);
    for (unsigned i = 0; i < TF_X + TF_M; ++i) s[TF_Z_X + i] = w0[tf_tape0_rows[i]];
  }
  tf_along(&tf_running, outputs ? TF_TAPE : TF_TAPE_RATES, s, v + TF_TAPE,
           v + 2 * (size_t)TF_TAPE, w);
  for (size_t i = 0; i < nu; ++i)
    result[i] = unknown[i] < TF_VR_DX ? s[tf_place(unknown[i])] : w[tf_row(unknown[i])];
  return tf_sloped(c, result, nu);
}

#ifdef TF_ADJOINT
static tf_status tf_adjoint(tf_instance* c, const unsigned* unknown, size_t nu,
                            const unsigned* known, size_t nk, const double* seed, double* result) {
  int outputs, initial = c->s.phase == TF_INITIALIZATION;
  tf_status status = tf_check_sides(c, unknown, nu, known, nk, &outputs);
  if (status == TF_OK) status = tf_prepare(c, outputs);
  if (status != TF_OK) return status;
  double *v = c->linear, *v0 = v + 4 * (size_t)TF_TAPE, *s = v0 + 4 * (size_t)TF_TAPE0 + TF_Z;
  double *w = v + 3 * (size_t)TF_TAPE, *w0 = v0 + 3 * (size_t)TF_TAPE0, *start = s + TF_Z;
  unsigned length = outputs ? TF_TAPE : TF_TAPE_RATES;
  memset(s, 0, TF_Z * sizeof(double));
  memset(w, 0, length * sizeof(double));
  for (size_t i = 0; i < nu; ++i) {
    if (unknown[i] < TF_VR_DX)
      s[tf_place(unknown[i])] += seed[i];
    else
      w[tf_row(unknown[i])] += seed[i];
  }
  tf_back(&tf_running, length, s, v + TF_TAPE, v + 2 * (size_t)TF_TAPE, w);
  if (initial) {
    memcpy(start, s + TF_Z_X, (TF_X + TF_M) * sizeof(double));
    memset(s + TF_Z_X, 0, (TF_X + TF_M) * sizeof(double));
    memset(w0, 0, TF_TAPE0 * sizeof(double));
    for (unsigned i = 0; i < TF_X + TF_M; ++i) w0[tf_tape0_rows[i]] += start[i];
    tf_back(&tf_starting, TF_TAPE0, s, v0 + TF_TAPE0, v0 + 2 * (size_t)TF_TAPE0, w0);
  }
  for (size_t i = 0; i < nk; ++i) result[i] = s[tf_place(known[i])];
  return tf_sloped(c, result, nk);
}
#endif
