/* Functions common to both versions of FMI: create, read, write, step, save. */

static const tf_program tf_ordinary[] = {TF_PROGRAMS(TF_ORDINARY)};
#ifdef TF_FAST
static const tf_program tf_fast[] = {TF_PROGRAMS(TF_QUICK)};
#include <cpuid.h>
/* Return whether processor and operating system support the vector instructions of the fast variant. */
static int tf_has_fast(void) {
  unsigned a, b, c, d, low, high;
  /* Leaf 1, ecx: bit 12 is FMA, bit 27 is OSXSAVE, which allows xgetbv. Leaf 7, ebx: bit 5 is AVX2. */
  if (!__get_cpuid(1, &a, &b, &c, &d) || !(c & 1u << 12) || !(c & 1u << 27)) return 0;
  if (!__get_cpuid_count(7, 0, &a, &b, &c, &d) || !(b & 1u << 5)) return 0;
  __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
  /* The operating system saves the registers of SSE (bit 1) and AVX (bit 2). */
  return (low & 6) == 6;
}
#else
#define tf_fast tf_ordinary
static int tf_has_fast(void) { return 0; }
#endif

static tf_status tf_enter(tf_instance* c, int phase) {
  c->s.phase = phase;
  return TF_OK;
}

static tf_status tf_reset(tf_instance* c) {
  tf_state* s = &c->s;
  int model_exchange = s->model_exchange;
  memset(s, 0, sizeof *s);
  s->phase = TF_INSTANTIATED;
  s->model_exchange = model_exchange;
  memcpy(s->x, tf_x_start, TF_X * sizeof(double));
  memcpy(s->d, tf_d_start, TF_D * sizeof(double));
  memcpy(s->p, tf_p_start, TF_P * sizeof(double));
#ifdef TF_VARIABLE
  s->control = (tf_control){.rtol = TF_TOLERANCE, .method = TF_METHOD, .automatic = TF_AUTOMATIC, .max_steps = 1};
#endif
  c->next_event = INFINITY;
  s->handled = -INFINITY;
  tf_touch(c);
  return TF_OK;
}

static tf_instance* tf_create(const char* name, int model_exchange, int logging) {
  tf_instance* c = calloc(1, sizeof *c);
  size_t length = strlen(name) + 1;
  if (c) c->name = malloc(length);
  if (!c || !c->name) {
    free(c);
    return NULL;
  }
  memcpy(c->name, name, length);
  c->programs = tf_has_fast() ? tf_fast : tf_ordinary;
  c->logging = logging;
  c->s.model_exchange = model_exchange;
  tf_reset(c);
  return c;
}

static void tf_free(tf_instance* c) {
  /* FMI: freeing a null pointer does nothing. */
  if (!c) return;
  free(c->linear);
  free(c->name);
  free(c);
}

static tf_status tf_start(tf_instance* c, int has_tolerance, double tolerance, double start, int has_stop,
                          double stop) {
#ifdef TF_VARIABLE
  if (has_tolerance && !c->s.model_exchange) {
    if (!(tolerance >= TF_LEAST_TOLERANCE && tolerance < 1))
      return tf_refuse(c, TF_ERROR, "a tolerance of %g is not from %g to below 1", tolerance, TF_LEAST_TOLERANCE);
    c->s.control.rtol = tolerance;
  }
#else
  (void)has_tolerance, (void)tolerance;
#endif
  if (!isfinite(start) || (has_stop && !(stop >= start)))
    return tf_refuse(c, TF_ERROR, "cannot start at %g and stop at %g", start, stop);
  c->s.start = c->s.time = c->s.last_good = start;
  c->s.has_stop = has_stop;
  c->s.stop = stop;
  tf_touch(c);
  return TF_OK;
}

static tf_status tf_leave_initialization(tf_instance* c) {
  tf_initialize(c);
  tf_touch(c);
  if (!tf_finite(c->s.x, TF_X) || !tf_sound(c->s.d))
    return tf_refuse(c, TF_ERROR, "a state is not finite at the start; check the parameters");
  /* FMI: after initialization, model exchange is in event mode. */
  return tf_enter(c, c->s.model_exchange ? TF_EVENT : TF_STEPPING);
}

/* -- reading ------------------------------------------------------------------------------- */

static void tf_read(tf_instance* c, unsigned first, unsigned n, double* values) {
  double t = tf_now(c);
  if (c->s.phase == TF_INITIALIZATION && !c->light_known && !c->heavy_known && !c->rates_known)
    tf_initialize(c);
  for (unsigned i = 0; i < n; ++i) {
    unsigned r = first + i;
    if (r >= TF_VR_G) {
      double indicators[TF_INDICATORS + 1];
      tf_state_indicators(c, indicators);
      values[i] = indicators[r - TF_VR_G];
    } else if (r >= TF_VR_MODES) {
      values[i] = tf_d(c)[r - TF_VR_MODES];
    } else if (r >= TF_VR_Y) {
      int place = tf_y_place[r - TF_VR_Y];
      if (place < TF_Y_LIGHT && !c->light_known) {
        c->programs[TF_light](&t, c->s.x, tf_d(c), c->s.p, c->y);
        c->light_known = 1;
      } else if (place >= TF_Y_LIGHT && !c->heavy_known) {
        c->programs[TF_heavy](&t, c->s.x, tf_d(c), c->s.p, c->y + TF_Y_LIGHT);
        c->heavy_known = 1;
      }
      values[i] = c->y[place];
    } else if (r >= TF_VR_DX) {
      if (!c->rates_known) {
        c->programs[TF_derivative](&t, c->s.x, tf_d(c), c->s.p, c->dx);
        c->rates_known = 1;
      }
      values[i] = c->dx[r - TF_VR_DX];
    } else if (r >= TF_VR_X) {
      values[i] = c->s.x[r - TF_VR_X];
    } else if (r >= TF_VR_P) {
      values[i] = c->s.p[r - TF_VR_P];
    } else {
      values[i] = r == TF_VR_TIME ? c->s.time : c->s.d[TF_D - TF_U + r - TF_VR_U];
    }
  }
}

static tf_status tf_unknown(tf_instance* c, const char* function, unsigned reference) {
  return tf_refuse(c, TF_ERROR, "%s: there is no variable with value reference %u", function,
                   reference);
}

/* -- writing ------------------------------------------------------------------------------- */

/* Return the reason why a variable cannot be set now, or NULL if it can. */
static const char* tf_obstacle(const tf_instance* c, unsigned r) {
  int early = c->s.phase & (TF_INSTANTIATED | TF_INITIALIZATION);
  if (r >= TF_VR_U && r < TF_VR_P) return NULL;
  if (r == TF_VR_TIME || r >= TF_VR_DX) return "it is calculated";
  if (r >= TF_VR_X) {
    if (!tf_x_exact[r - TF_VR_X]) return "it is calculated from parameters or inputs; set those";
    return early ? NULL : "a state can be set here only before the end of initialization";
  }
  if (early) return NULL;
  if (!tf_p_tunable[r - TF_VR_P])
    return "a fixed parameter can be set only before the end of initialization";
  if (c->s.phase & (TF_STEPPING | TF_EVENT)) return NULL;
  return "a tunable parameter can be set between steps or in event mode only";
}

/* Check whether variables may be set now, and to these values. */
static tf_status tf_may_write(tf_instance* c, unsigned first, unsigned n, const double* values) {
  for (unsigned i = 0; i < n; ++i) {
    const char* why = tf_obstacle(c, first + i);
    int finite = isfinite(values[i]);
    if (!why && finite) continue;
    unsigned element;
    const char* name = tf_name_of(first + i, &element);
    return tf_refuse(c, why ? TF_ERROR : TF_DISCARD, "cannot set %s (element %u): %s", name,
                     element, why ? why : "the value is not finite");
  }
  return TF_OK;
}

static void tf_write(tf_instance* c, unsigned first, unsigned n, const double* values) {
  for (unsigned i = 0; i < n; ++i) {
    unsigned r = first + i;
    if (r >= TF_VR_X)
      c->s.x[r - TF_VR_X] = values[i];
    else if (r >= TF_VR_P)
      c->s.p[r - TF_VR_P] = values[i];
    else
      c->s.d[TF_D - TF_U + r - TF_VR_U] = values[i];
  }
  tf_touch(c);
}

/* -- model exchange ------------------------------------------------------------------------ */

static tf_status tf_count(tf_instance* c, size_t n) {
  return n == TF_X ? TF_OK : tf_refuse(c, TF_ERROR, "there are %d states", TF_X);
}

static tf_status tf_set_time(tf_instance* c, double time) {
  if (!isfinite(time)) return tf_refuse(c, TF_DISCARD, "the time is not finite");
  c->s.time = time;
  tf_touch(c);
  return TF_OK;
}

static tf_status tf_set_states(tf_instance* c, const double* x, size_t n) {
  if (tf_count(c, n) != TF_OK) return TF_ERROR;
  if (!tf_finite(x, TF_X)) return tf_refuse(c, TF_DISCARD, "a state is not finite");
  memcpy(c->s.x, x, TF_X * sizeof(double));
  tf_touch(c);
  return TF_OK;
}

static tf_status tf_states(tf_instance* c, double* x, size_t n) {
  if (tf_count(c, n) != TF_OK) return TF_ERROR;
  tf_read(c, TF_VR_X, TF_X, x);
  return TF_OK;
}

static tf_status tf_rates(tf_instance* c, double* rates, size_t n) {
  if (tf_count(c, n) != TF_OK) return TF_ERROR;
  tf_read(c, TF_VR_DX, TF_X, rates);
  if (tf_finite(rates, TF_X)) return TF_OK;
  return tf_refuse(c, TF_DISCARD, "a derivative is not finite at %.9g", c->s.time);
}

static tf_status tf_nominals(tf_instance* c, double* nominals, size_t n) {
  if (tf_count(c, n) != TF_OK) return TF_ERROR;
  for (size_t i = 0; i < n; ++i) nominals[i] = 1;
  return TF_OK;
}

static tf_status tf_indicators(tf_instance* c, double* indicators, size_t n) {
  if (n != TF_INDICATORS)
    return tf_refuse(c, TF_ERROR, "there are %d event indicators", TF_INDICATORS);
  tf_state_indicators(c, indicators);
  return TF_OK;
}

/* Return whether a block is sampled now or a signal is not smooth. No state jumps then, but derivatives
   may, and some importers restart the integration only if a jump of the states is reported. */
static int tf_jumped(tf_instance* c) {
  return TF_X && (tf_pending(c) || c->s.time >= c->next_event - tf_same(c->s.time));
}

/* Handle the events of this time: first located and time events, then events caused by sampled blocks. */
static tf_status tf_handle(tf_instance* c, int* jumped) {
  *jumped = tf_jumped(c);
#if TF_EVENTS
  double t = tf_now(c), h = TF_STEP_NUMERATOR / TF_STEP_DENOMINATOR;
  const tf_model m = TF_MODEL_OF(TF_OWN, tf_kinds, TF_SIDES);
  c->stepper.count = 0, c->stepper.last = c->s.happened;
  c->s.handled = t;
  for (int sampled = 0; sampled < 2; ++sampled) {
    double* d = sampled ? (double*)tf_d(c) : c->s.d;
    if (sampled && !tf_pending(c)) break;
    if (!tf_indicate(&m, &c->stepper, t, c->s.x, d, c->s.p)) return tf_event_fault(c, TF_BAD_INDICATOR, t);
    int happens = tf_mark(&m, &c->stepper, t, d);
    if (sampled && !happens) break; /* inputs may still change the sampled values */
    if (sampled && !tf_commit(c)) return tf_event_fault(c, TF_BAD_D, t);
    int fault = tf_settle(&m, &c->stepper, t, h, !sampled, c->s.x, c->s.d, c->s.p);
    c->s.happened = c->stepper.last;
    if (fault != TF_FINE) return tf_event_fault(c, fault, t);
    if (happens) *jumped = TF_X > 0;
    tf_touch(c);
  }
#endif
  return TF_OK;
}

static tf_status tf_enter_continuous(tf_instance* c) {
  if (!tf_commit(c))
    return tf_refuse(c, TF_ERROR, "a sampled value is not finite at time %.9g", c->s.time);
  tf_plan_event(c);
  tf_touch(c);
  tf_complete(c); /* no check: derivatives are not finite if a loop has no solution */
  return tf_enter(c, TF_CONTINUOUS);
}

/* -- steps --------------------------------------------------------------------------------- */

static tf_status tf_communication_step(tf_instance* c, double time, double step, int all_or_nothing) {
  if (!(step > 0) || !isfinite(step))
    return tf_refuse(c, TF_ERROR, "a step of %g is not positive and finite", step);
  if (!(fabs(time - c->s.time) <= 100 * tf_same(time)))
    return tf_refuse(c, TF_ERROR, "the step starts at %.9g, but the last one ended at %.9g", time,
                     c->s.time);
  double target = time + step;
  if (c->s.has_stop && target > c->s.stop + 100 * tf_same(target))
    return tf_refuse(c, TF_ERROR, "the step ends at %.9g, after the stop time %.9g", target,
                     c->s.stop);
  memcpy(&c->before, &c->s, sizeof c->s);
  tf_status status = tf_advance(c, target);
  if (status != TF_OK && all_or_nothing) {
    memcpy(&c->s, &c->before, sizeof c->s);
    tf_touch(c);
  }
  return status;
}

/* -- saved states -------------------------------------------------------------------------- */

#define TF_SERIALIZED (sizeof(TF_TOKEN) + sizeof(tf_state) + sizeof(unsigned long long))

/* Checksum (FNV-1a): damaged numbers of points or methods would be indices outside of arrays. */
static unsigned long long tf_checksum(const void* saved) {
  unsigned long long sum = 14695981039346656037ull;
  for (size_t i = 0; i < sizeof(tf_state); ++i) sum = (sum ^ ((const unsigned char*)saved)[i]) * 1099511628211ull;
  return sum;
}

static tf_status tf_save(tf_instance* c, void** saved) {
  /* FMI: a null pointer requests a new state; else the given state is overwritten. */
  if (!*saved) *saved = malloc(sizeof(tf_state));
  if (!*saved) return tf_refuse(c, TF_ERROR, "out of memory");
  memcpy(*saved, &c->s, sizeof(tf_state));
  return TF_OK;
}

static tf_status tf_restore(tf_instance* c, const void* saved) {
  if (!saved) return tf_refuse(c, TF_ERROR, "there is no saved state to go back to");
  if (((const tf_state*)saved)->model_exchange != c->s.model_exchange)
    return tf_refuse(c, TF_ERROR, "the saved state is of the other FMI type (model exchange, co-simulation)");
  memcpy(&c->s, saved, sizeof(tf_state));
  tf_touch(c);
  tf_plan_event(c);
  return TF_OK;
}

static tf_status tf_forget(void** saved) {
  if (saved) {
    free(*saved);
    *saved = NULL;
  }
  return TF_OK;
}

static tf_status tf_pack(tf_instance* c, const void* saved, unsigned char* bytes, size_t size) {
  if (!saved || size < TF_SERIALIZED)
    return tf_refuse(c, TF_ERROR, "there is no saved state, or the buffer is too small");
  /* The token makes another export of the model refuse the bytes. */
  memcpy(bytes, TF_TOKEN, sizeof TF_TOKEN);
  memcpy(bytes + sizeof TF_TOKEN, saved, sizeof(tf_state));
  unsigned long long sum = tf_checksum(saved);
  memcpy(bytes + sizeof TF_TOKEN + sizeof(tf_state), &sum, sizeof sum);
  return TF_OK;
}

static tf_status tf_unpack(tf_instance* c, const unsigned char* bytes, size_t size, void** saved) {
  if (size != TF_SERIALIZED || memcmp(bytes, TF_TOKEN, sizeof TF_TOKEN))
    return tf_refuse(c, TF_ERROR, "these bytes are no saved state of this FMU");
  unsigned long long sum = tf_checksum(bytes + sizeof TF_TOKEN);
  if (memcmp(bytes + sizeof TF_TOKEN + sizeof(tf_state), &sum, sizeof sum))
    return tf_refuse(c, TF_ERROR, "the saved state is damaged");
  tf_status status = tf_save(c, saved); /* allocates *saved */
  if (status == TF_OK) memcpy(*saved, bytes + sizeof TF_TOKEN, sizeof(tf_state));
  return status;
}
