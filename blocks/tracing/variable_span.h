/* A span of variable steps with the events and the logged rows in it; follows events.h. The twin in Python is
   `VariableSteps.advance` in blocks/simulation/adaptive.py: a change here needs one there. */

/* Go to the end of the step that was taken last, or to the first event in it. */
static int tf_arrive(const tf_model* m, tf_stepper* s, tf_variable* v, double* x, double* d, const double* p) {
  tf_control* c = v->control;
  const double after = v->now < v->last ? v->now : v->last;
#if TF_EVENTS
  int fault;
#endif
  memcpy(x, s->steps.next, TF_X * sizeof *x);
  c->t = v->now, c->stepped = 0;
  if (v->method->gamma == 0.0)
    memcpy(v->slope, v->k[v->method->stages], TF_X * sizeof *x);
  else
    v->has_slope = 0;
#if TF_EVENTS
  if ((fault = tf_settle(m, s, v->now, v->h, 1, x, d, p)) != TF_FINE) return fault;
#endif
  /* A jump makes the step size and the slope invalid: the solver starts anew. */
  if (v->event) c->h = 0.0, v->has_slope = 0;
  return tf_keep(m, after, x, d, p);
}

/* Advance to control->end, where d changes next. Returns before it if the steps or the rows are used up. */
static int tf_vary_between(const tf_model* m, tf_stepper* s, tf_variable* v, double* x, double* d,
                           const double* p, const double* times, double* log, long long log_width) {
  tf_control* c = v->control;
  int fault = TF_FINE;
  c->rows = 0, c->failed = NAN;
  if (!c->begun) {
#if TF_EVENTS
    s->count = 0;
    if (!tf_indicate(m, s, c->t, x, d, p)) return TF_BAD_INDICATOR;
    if ((fault = tf_settle(m, s, c->t, 0.0, 0, x, d, p)) != TF_FINE) return fault;
#endif
    c->begun = 1, c->stepped = 0, c->h = 0.0, v->has_slope = 0;
  }
  for (long long left = c->max_steps;;) {
    if (!c->stepped) {
      double stop = c->end;
      if (c->t >= c->end || left-- <= 0) return TF_FINE;
#if TF_EVENTS
      memcpy(s->start, s->g, sizeof s->start);
      for (int i = 0; i < TF_EVENTS; ++i)
        if (m->kinds[i] == 2 && s->g[i] < stop) stop = s->g[i];
#endif
      if (!tf_step(v, stop)) return TF_STUCK;
#if TF_STIFF
      if (c->automatic && v->method->gamma == 0.0 && tf_stiff(v)) {
        c->method = TF_STIFF_METHOD, c->switched = c->t;
        v->has_slope = 0;
      }
#endif
      memcpy(s->steps.next, v->next, sizeof v->next);
      c->stepped = 1, v->event = 0;
#if TF_EVENTS
      if (!tf_indicate(m, s, v->now, s->steps.next, d, p)) return c->failed = v->now, TF_BAD_INDICATOR;
      v->event = tf_mark(m, s, v->now, d);
      if (v->event) {
        v->now = tf_locate(m, s, TF_DENSE, c->t, v->now, x, d, p);
        if (!tf_indicate(m, s, v->now, s->steps.next, d, p)) return c->failed = v->now, TF_BAD_INDICATOR;
      }
#endif
    }
#if TF_OUTPUTS
    while (c->rows < c->due_rows && times[c->rows] < v->now) {
      double row = times[c->rows];
      if (c->rows == c->room) return TF_FINE;
      tf_interpolate(v, row, v->stage);
      tf_run_outputs(&row, v->stage, d, p, log + c->rows++ * log_width);
    }
#endif
    if ((fault = tf_arrive(m, s, v, x, d, p)) != TF_FINE) return fault;
  }
}
