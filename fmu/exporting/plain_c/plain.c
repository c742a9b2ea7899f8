/* Initialization, ticks and the step. The generated part of the source precedes this
   file: sizes, tables, the equations, and TF_MODEL and TF_NAME(name), the type and its functions. */

static double tf_time(const TF_MODEL* m) { return (double)m->tick * TF_STEP_NUMERATOR / TF_STEP_DENOMINATOR; }

/* Compute the states that follow from parameters and inputs. */
static void tf_initialize(TF_MODEL* m) {
  const double t = 0.0;
  double* start = m->start;
  tf_run_initialization(&t, m->x, m->d, m->p, start);
  memcpy(m->x, start, TF_X * sizeof(double));
  memcpy(m->d, start + TF_X, TF_M * sizeof(double));
}

/* Return the current d, including the current tick, computed from the inputs set so far. It becomes
   final with the step. */
static double* tf_now(TF_MODEL* m) {
  if (!m->known) {
    const double t = tf_time(m);
    if (!m->tick && !m->begun) tf_initialize(m);
    const int due = tf_due(m->tick);
    if (due)
      tf_samples[due](&t, m->x, m->d, m->p, m->now);
    else
      memcpy(m->now, m->d, TF_D * sizeof(double));
    m->known = 1;
  }
  return m->now;
}

static const double* tf_outputs(TF_MODEL* m) {
  const double t = tf_time(m);
  const double* d = tf_now(m);
  if (m->known == 1) {
    tf_run_outputs(&t, m->x, d, m->p, m->y);
    m->known = 2;
  }
  return m->y;
}

void TF_NAME(init)(TF_MODEL* m) {
  memset(m, 0, sizeof *m);
  memcpy(m->x, tf_x_start, TF_X * sizeof(double));
  memcpy(m->d, tf_d_start, TF_D * sizeof(double));
  memcpy(m->p, tf_p_start, TF_P * sizeof(double));
}

double TF_NAME(time)(const TF_MODEL* m) { return tf_time(m); }

int TF_NAME(step)(TF_MODEL* m) {
  static const double h = TF_STEP_NUMERATOR / TF_STEP_DENOMINATOR;
  const tf_model model = TF_MODEL_OF(TF_RUN, tf_kinds, TF_SIDES);
  tf_stepper stepper;
  double t = tf_time(m), end = (double)(m->tick + 1) * TF_STEP_NUMERATOR / TF_STEP_DENOMINATOR;
  double *d = tf_now(m), *x = m->start;
  if (!tf_sound(d)) return 1;
  memcpy(x, m->x, TF_X * sizeof(double));
  m->known = 0; /* the step changes d even if it fails */
  int fault = tf_between(&model, &stepper, TF_RK4, &t, end, h, 1, 0, x, d, m->p);
  if (fault != TF_FINE) return fault == TF_ENDED ? 2 : 1;
  memcpy(m->x, x, TF_X * sizeof(double));
  memcpy(m->d, d, TF_D * sizeof(double));
  m->begun = 1;
  ++m->tick;
  return 0;
}
