/* Time grid in whole steps from the start, ticks, and events at an instant. */

static double tf_grid(const tf_instance* c, long long k) {
  double t = (double)k * TF_STEP_NUMERATOR / TF_STEP_DENOMINATOR;
  return c->s.start == 0.0 ? t : c->s.start + t;
}

/* Tolerance of equal times, because importers sum steps with round-off errors. */
static double tf_same(double t) {
  return 1e-6 * TF_STEP_NUMERATOR / TF_STEP_DENOMINATOR + 1e-11 * fabs(t);
}

/* Return the first grid point after k with a tick, or -1 if there is none: see tf_due. */
static long long tf_next_due(long long k) {
  long long found = -1;
  for (int i = 0; i < TF_CLOCKS; ++i) {
    long long offset = tf_clocks[i].offset, period = tf_clocks[i].period;
    long long next = k < offset ? offset : offset + ((k - offset) / period + 1) * period;
    if (found < 0 || next < found) found = next;
  }
  return found;
}

/* Return the sample program of a tick that is not final yet, or 0. */
static int tf_pending(const tf_instance* c) {
  if (TF_CLOCKS == 0 || c->s.partial || c->s.sampled) return 0;
  if (!(c->s.phase & (TF_EVENT | TF_STEPPING | TF_INITIALIZATION))) return 0;
  return tf_due(c->s.tick);
}

/* Return the evaluation time of the equations. It stays before the next event until event mode, so
   that a solver does not evaluate a jump of a signal too early. */
static double tf_now(const tf_instance* c) {
  if (c->s.phase & (TF_STEPPING | TF_FAILED) && !c->s.partial) return tf_grid(c, c->s.tick);
  if (c->s.phase == TF_CONTINUOUS && c->s.time >= c->next_event)
    return tf_just_before(c->next_event);
  return c->s.time;
}

/* Invalidate all results computed from changed values. */
static void tf_touch(tf_instance* c) {
  c->light_known = c->heavy_known = c->rates_known = c->instant_known = c->linear_known = 0;
}

/* Return the current d, including the result of a tick that is not final yet. */
static const double* tf_d(tf_instance* c) {
  int due = tf_pending(c);
  if (!due) return c->s.d;
  if (!c->instant_known) {
    double t = tf_now(c);
    c->programs[due](&t, c->s.x, c->s.d, c->s.p, c->d_instant);
    c->instant_known = 1;
  }
  return c->d_instant;
}

/* Make the current tick final; return 0 if a value is not finite. */
static int tf_commit(tf_instance* c) {
  if (tf_pending(c)) {
    const double* d = tf_d(c);
    if (!tf_sound(d)) return 0;
    memcpy(c->s.d, d, TF_D * sizeof(double));
    tf_touch(c);
  }
  c->s.sampled = 1;
  return 1;
}

/* Compute the states that follow from parameters and inputs. */
static void tf_initialize(tf_instance* c) {
  double t = c->s.time;
  c->programs[TF_initialization](&t, c->s.x, c->s.d, c->s.p, c->scratch);
  memcpy(c->s.x, c->scratch, TF_X * sizeof(double));
  memcpy(c->s.d, c->scratch + TF_X, TF_M * sizeof(double));
}

#define TF_OWN(name) c->programs[TF_##name]

/* Compute the indicators of state events at the evaluation time. An indicator that is almost zero after an
   event gets the sign of its side, so that importers detect when it leaves that side. It keeps this sign while
   it stays at zero, as for a body at rest, which is not an event. */
static void tf_state_indicators(tf_instance* c, double* indicators) {
#if TF_EVENTS
  double t = tf_now(c);
  const double *d = tf_d(c), *side = d + TF_SIDES;
  c->programs[TF_indicators](&t, c->s.x, d, c->s.p, c->stepper.g);
  for (int i = 0; i < TF_EVENTS; ++i)
    if (tf_kinds[i] != 2) {
      int at_zero = (t == c->s.handled || c->stepper.g[i] == 0.0) && side[i] != 0.0 && fabs(side[i]) < 1.0;
      *indicators++ = at_zero ? side[i] * 1e-300 : c->stepper.g[i];
    }
#else
  (void)c, (void)indicators;
#endif
}

/* Log why a step or an event failed; a terminal event is no failure. */
static tf_status tf_event_fault(tf_instance* c, int fault, double t) {
  if (fault == TF_ENDED) {
    c->s.ended = 1;
    return TF_OK;
  }
  static const char* const why[] = {
      "", "a state stopped being finite", "a sampled value or a mode stopped being finite",
      "an event indicator is not a number",
      "events without end: a time event that does not move on, modes that call each other "
      "back, or events that follow each other ever faster",
      "an algebraic loop cannot be solved",
      "no step is small enough: a derivative is not finite, or the tolerance is too small", "",
      "a delay has no room for more points: export it with more"};
  return tf_refuse(c, TF_DISCARD, "%s at time %.9g", why[fault], t);
}

/* Keep what the end of a step gives: solutions of algebraic loops, and points of histories. */
static int tf_complete(tf_instance* c) {
  const tf_model m = TF_MODEL_OF(TF_OWN, tf_kinds, TF_SIDES);
#if TF_STORED
  int fault = tf_record(&m, tf_now(c), 0, c->s.x, c->s.d, c->s.p);
  if (fault != TF_FINE) return fault;
#endif
  return tf_keep(&m, tf_now(c), c->s.x, c->s.d, c->s.p);
}

/* Compute the next time event of model exchange: a tick, a non-smooth point of a signal, or a time event. */
static void tf_plan_event(tf_instance* c) {
  long long k = tf_next_due(c->s.tick);
  c->next_event = k < 0 ? INFINITY : tf_grid(c, k);
  for (int i = 0; i < TF_BREAKS; ++i)
    if (tf_breaks[i] > c->s.time + tf_same(c->s.time) && tf_breaks[i] < c->next_event)
      c->next_event = tf_breaks[i];
#if TF_EVENTS
  c->programs[TF_indicators](&c->s.time, c->s.x, c->s.d, c->s.p, c->stepper.g);
  /* One that differs from those by round-off is at their time: a signal that jumps there has jumped then. */
  double sooner = c->next_event - tf_same(c->s.time);
  for (int i = 0; i < TF_EVENTS; ++i)
    if (tf_kinds[i] == 2 && c->stepper.g[i] < sooner) c->next_event = sooner = c->stepper.g[i];
#endif
}

/* Enter event mode and detect a tick; the importer's time may differ from the event by round-off. */
static tf_status tf_enter_event(tf_instance* c) {
  long long k = tf_next_due(c->s.tick);
  if (c->s.phase == TF_EVENT) return TF_OK;
  c->s.phase = TF_EVENT;
  if (fabs(c->next_event - c->s.time) <= tf_same(c->s.time)) c->s.time = c->next_event;
  if (k >= 0 && c->s.time >= tf_grid(c, k) - tf_same(c->s.time)) {
    c->s.tick = k;
    c->s.sampled = 0;
  }
  tf_touch(c);
  return TF_OK;
}

/* Integrate without ticks from *at to `end`, h later; *at is the time reached. Stop at the first event if `once`. */
static int tf_integrate(tf_instance* c, double* at, double end, double h, int once) {
  const tf_model m = TF_MODEL_OF(TF_OWN, tf_kinds, TF_SIDES);
#ifdef TF_VARIABLE
  /* The solver starts anew in each call, so that results depend on the saved state only. */
  tf_control* control = &c->s.control;
  tf_variable* v = &c->variable;
  int fault;
  control->t = *at, control->end = end, control->begun = 0;
  control->atol = 0.01 * control->rtol;
  v->control = control, v->x = c->s.x, v->d = c->s.d, v->p = c->s.p;
  v->derivative = m.derivative;
#if TF_STIFF
  v->tangent = c->programs[TF_tangent];
#endif
  v->last = tf_just_before(end);
  c->stepper.steps.variable = v;
  (void)h;
  do {
    fault = tf_vary_between(&m, &c->stepper, v, c->s.x, c->s.d, c->s.p, NULL, NULL, 0);
    *at = control->t;
  } while (fault == TF_FINE && *at < end && !(once && v->event));
  return fault;
#else
  return tf_between(&m, &c->stepper, TF_RK4, at, end, h, 1, once, c->s.x, c->s.d, c->s.p);
#endif
}

/* Return the next grid point at which a step must end: with fixed steps each one, otherwise the next tick. */
static long long tf_next_end(const tf_instance* c) {
#ifdef TF_VARIABLE
  return tf_next_due(c->s.tick);
#else
  return c->s.tick + 1;
#endif
}

/* Integrate to a time; if a value is not finite, the state stays at the last good step. */
static tf_status tf_advance(tf_instance* c, double target) {
  double same = tf_same(target);
  const double h_grid = TF_STEP_NUMERATOR / TF_STEP_DENOMINATOR;
  for (;;) {
    double t = c->s.partial ? c->s.time : tf_grid(c, c->s.tick);
    long long k = tf_next_end(c);
    double next = k < 0 ? INFINITY : tf_grid(c, k);
    int whole = next <= target + same;
    /* After an event just before a grid point (round-off), the step must continue to that point. At a grid point
       it must not begin for round-off only, which would make ticks final. */
    if (c->s.partial ? t >= target && !whole : target - t <= same) break;
    if (!c->s.partial && !tf_commit(c))
      return tf_refuse(c, TF_DISCARD, "a sampled value stopped being finite at time %.9g", t);
    double h = c->s.partial || !whole ? (whole ? next : target) - t : h_grid;
    double end = whole ? next : target, at = t;
#ifdef TF_VARIABLE
    for (int i = 0; i < TF_BREAKS; ++i)
      if (tf_breaks[i] > t && tf_breaks[i] < end) end = tf_breaks[i], whole = 0;
    h = end - t;
#endif
    int early = c->may_return_early && target - t > same;
    c->stepper.last = c->s.happened;
    int fault = tf_integrate(c, &at, end, h, early);
    c->s.happened = c->stepper.last;
    tf_touch(c);
    if (at > t) {
      whole = whole && at == end;
      if (whole) c->s.tick = k;
      c->s.partial = !whole;
      if (whole) c->s.sampled = 0;
      c->s.last_good = c->s.time = at;
    }
    if (fault == TF_BAD_STATE)
      return tf_refuse(
          c, TF_DISCARD,
          "a state stopped being finite in the step of %.9g from time %.9g, the last good one", h, at);
    if (fault != TF_FINE) return tf_event_fault(c, fault, at);
    if (at < end && target - at > same) return TF_OK; /* an event ended the step early */
  }
  c->s.last_good = c->s.time = target;
  return TF_OK;
}
