/* Steps with the events in them, for simulations (driver.c), native FMUs and plain C; stands behind
   fixed_step.h. The twin in Python is `EventWatch` in blocks/simulation/events.py: what changes here changes
   there. TF_EVENTS, TF_MODES, TF_LOOPS, TF_STORED and TF_D, the numbers of events, of modes, of signals of
   algebraic loops that are iterated, of stored signals and of what is in d, are defined before. In d, modes come
   first; at `sides` it says on which side of zero each indicator is, behind that which events happen now, then what
   the loops were solved by, then the histories of stored signals, see history.h.

   A side is 1 or -1; a half of that where the indicator is at zero, or as good as, and belongs to that side
   all the same, a quarter where it turned back at its event, and may be beyond zero by round-off; 0 where
   nothing is known. */

enum { TF_FINE, TF_BAD_STATE, TF_BAD_D, TF_BAD_INDICATOR, TF_ENDLESS, TF_BAD_LOOP, TF_STUCK, TF_ENDED, TF_FULL,
       TF_PYTHON };

typedef struct {
  tf_program derivative, indicators, on_event, guesses, stored;
  const signed char* kinds; /* 1: rising, -1: falling, 0: both, 2: the indicator is a time, 3: rising, and ends the run */
  int sides;
} tf_model;

typedef struct {
  tf_steps steps;
  tf_number g[TF_EVENTS + 1], start[TF_EVENTS + 1], after[TF_X + TF_MODES + 1];
  double last; /* when the last event was, and how many there were as good as at one time */
  int count;
} tf_stepper;

/* Whether what is in d is finite; modes, as when something happens next, may be infinite. */
static inline int tf_sound(const tf_number* d) {
  const double* mode = (const double*)d;
  int sound = tf_finite(d + TF_MODES, TF_D - TF_MODES);
  for (int i = 0; i < TF_MODES * (int)(sizeof *d / sizeof *mode); ++i) sound &= mode[i] == mode[i];
  return sound;
}

#define TF_RUN(name) tf_run_##name /* a program, where it is a function of that name */

#if TF_LOOPS
#define TF_GUESSES(program) program(guesses)
#else
#define TF_GUESSES(program) 0
#endif

/* Keep in d the solutions of algebraic loops: the next search starts there. */
static int tf_keep(const tf_model* m, double t, const tf_number* x, tf_number* d, const tf_number* p) {
#if TF_LOOPS
  tf_number solved[TF_LOOPS];
  m->guesses(&t, x, d, p, solved);
  if (!tf_finite(solved, TF_LOOPS)) return TF_BAD_LOOP;
  memcpy(d + m->sides + 2 * TF_EVENTS, solved, sizeof solved);
#else
  (void)m, (void)t, (void)x, (void)d, (void)p;
#endif
  return TF_FINE;
}

#if TF_EVENTS
#if TF_STORED
#define TF_STORED_OF(program) program(stored)
#define TF_HEADER 4 /* numbers before the points of a history, see history.h */

/* The largest modulus of the elements from `begin` to `end` in the last points, at most four, of the last piece. */
static double tf_largest(const double* h, int begin, int end) {
  const long long count = (long long)h[0], room = (long long)h[1];
  const int width = 2 + (int)h[2];
  const double *ring = h + TF_HEADER, piece = ring[(count - 1) % room * width + 1];
  double largest = 0.0;
  for (long long i = count - 1; i >= 0 && i > count - 5 && ring[i % room * width + 1] == piece; --i)
    for (int e = begin; e < end; ++e) largest = fmax(largest, fabs(ring[i % room * width + 2 + e]));
  return largest;
}

/* Store a point of a signal; false if a point is lost that is needed. The twin in Python is in history.py. */
static int tf_store(double* h, double t, const double* values) {
  const long long count = (long long)h[0], room = (long long)h[1];
  const int size = (int)h[2], width = 2 + size;
  double *ring = h + TF_HEADER, *point = ring + count % room * width, piece = 1.0;
  if (count) {
    double* last = ring + (count - 1) % room * width;
    piece = last[1];
    if (t - last[0] <= 1e-9 * h[3]) {
      double noise = 1e-12 * tf_largest(h, 0, size);
      int jumps = 0;
      for (int e = 0; e < size; ++e)
        jumps |= fabs(values[e] - last[2 + e]) > fmax(noise, 1e-7 * tf_largest(h, e, e + 1));
      if (!jumps) return 1;
      /* a piece of one point at this time has no length: the new value replaces it */
      if (count == 1 || ring[(count - 2) % room * width + 1] != piece) {
        memcpy(last + 2, values, size * sizeof *values);
        return 1;
      }
      piece += 1.0;
    }
  }
  int needed = count >= room && ring[(count + 2) % room * width] > t - h[3];
  point[0] = t, point[1] = piece, h[0] += 1.0;
  memcpy(point + 2, values, size * sizeof *values);
  return !needed;
}

/* Store the signals of time t, and before these those just before t if `before`. */
static int tf_record(const tf_model* m, double t, int before, const double* x, double* d, const double* p) {
  double values[TF_STORED];
  for (; before >= 0; --before) {
    double at = before ? tf_just_before(t) : t, *h = d + m->sides + 2 * TF_EVENTS + TF_LOOPS;
    m->stored(&at, x, d, p, values);
    for (int i = 0; i < TF_STORED; i += (int)h[2], h += TF_HEADER + (long long)h[1] * (2 + (long long)h[2]))
      if (!tf_store(h, t, values + i)) return TF_FULL;
  }
  return TF_FINE;
}
#else
#define TF_STORED_OF(program) 0
#endif
#define TF_MODEL_OF(program, kinds, sides)                                              \
  {program(derivative), program(indicators),  program(on_event), TF_GUESSES(program), \
   TF_STORED_OF(program), kinds, sides}
#define TF_PLACE 2.220446049250313e-16 /* the last place of a number, relative to it */

static inline double tf_size_of(double t) { return t < 0.0 ? -t : t; }

/* Whether an event happens where its indicator is g. */
static inline int tf_happens(int kind, double side, double g, double t) {
  if (kind == 2) return g <= t + 4 * TF_PLACE * tf_size_of(t); /* a sample instant may be an event but for round-off */
  if (side > 0.0 && kind <= 0) return side < 1.0 ? g < 0.0 : g <= 0.0;
  if (side < 0.0 && kind >= 0) return side > -1.0 ? g > 0.0 : g >= 0.0;
  return 0;
}

/* Whether what is on that side turned back at this very time: its event has been handled. */
static inline int tf_quiet(const tf_stepper* s, double side, double t) {
  return tf_size_of(side) == 0.25 && t == s->last;
}

/* Compute the indicators; false if one is not a number. */
static int tf_indicate(const tf_model* m, tf_stepper* s, double t, const tf_number* x, const tf_number* d,
                       const tf_number* p) {
  int good = 1;
  m->indicators(&t, x, d, p, s->g);
  for (int i = 0; i < TF_EVENTS; ++i) good &= s->g[i] == s->g[i];
  return good;
}

/* Mark in d which events happen with the indicators as they are; whether any does. */
static int tf_mark(const tf_model* m, const tf_stepper* s, double t, tf_number* d) {
  double *side = d + m->sides, *fired = side + TF_EVENTS;
  int any = 0;
  for (int i = 0; i < TF_EVENTS; ++i) {
    int happens = tf_happens(m->kinds[i], side[i], s->g[i], t) && !tf_quiet(s, side[i], t);
    fired[i] = happens;
    any |= happens;
  }
  return any;
}

/* Handle the events that happen, and those that they cause, until none does any more. `located` says that
   the first are those of a step of length h; the others happen by a jump. */
static int tf_settle(const tf_model* m, tf_stepper* s, double t, double h, int located, tf_number* x,
                     tf_number* d, const tf_number* p) {
  double *side = d + m->sides, *fired = side + TF_EVENTS, *ahead = s->start;
#if TF_STORED
  if (tf_record(m, t, located, x, d, p) != TF_FINE) return TF_FULL;
  if (!tf_indicate(m, s, t, x, d, p)) return TF_BAD_INDICATOR;
#endif
  for (;; located = 0) {
    int any = tf_mark(m, s, t, d);
    for (int i = 0; i < TF_EVENTS; ++i)
      if (tf_quiet(s, side[i], t))
        continue;
      else if (!fired[i] && s->g[i] != 0.0)
        side[i] = s->g[i] > 0.0 ? 1.0 : -1.0;
      else if (!fired[i] && tf_size_of(side[i]) == 1.0)
        side[i] *= -0.5; /* zero belongs to where it was going */
      else if (!fired[i] && side[i] == 0.0)
        side[i] = m->kinds[i] < 0 ? 0.5 : -0.5; /* at the start, to where an event leaves it */
    if (!any) return TF_FINE;
    for (int i = 0; i < TF_EVENTS; ++i)
      if (fired[i] && m->kinds[i] == 3) return TF_ENDED;
    s->count = t - s->last <= 1000 * TF_PLACE * (tf_size_of(t) + h) ? s->count + 1 : 1;
    for (int i = 0; i < TF_EVENTS; ++i) /* an arc that is too short to be located ends where it began */
      if (fired[i] && tf_size_of(side[i]) == 0.25 && t - s->last <= 8 * TF_PLACE * tf_size_of(t))
        return TF_ENDLESS;
    s->last = t;
    if (s->count > 200) return TF_ENDLESS;
    double at = t;
    for (int i = 0; i < TF_EVENTS; ++i)
      if (fired[i] && m->kinds[i] == 2 && s->g[i] > at) at = s->g[i];
    m->on_event(&at, x, d, p, s->after);
    memcpy(s->steps.next, s->after, TF_X * sizeof(tf_number));
    if (!tf_finite(s->after, TF_X)) return TF_BAD_STATE;
    memcpy(x, s->after, TF_X * sizeof(tf_number));
    memcpy(d, s->after + TF_X, TF_MODES * sizeof(tf_number));
    if (!tf_sound(d)) return TF_BAD_D;
#if TF_STORED
    if (tf_record(m, t, 0, x, d, p) != TF_FINE) return TF_FULL;
#endif
    if (!tf_indicate(m, s, t, x, d, p)) return TF_BAD_INDICATOR;
    if (located) { /* where do they go from here? */
      double soon = t + 1e-6 * h, *g = s->g;
      m->derivative(&t, x, d, p, s->steps.rate);
      for (int i = 0; i < TF_X; ++i) s->steps.stage[i] = x[i] + 1e-6 * h * s->steps.rate[i];
      m->indicators(&soon, s->steps.stage, d, p, ahead);
      for (int i = 0; i < TF_EVENTS; ++i) {
        double old = side[i] > 0.0 ? 1.0 : -1.0;
        int on = ahead[i] == g[i] ? g[i] * old < 0.0 : ahead[i] * old < g[i] * old;
        if (fired[i] && (m->kinds[i] == 1 || m->kinds[i] == -1) && g[i] * old <= 0.0)
          side[i] = on ? -0.5 * old : 0.25 * old, fired[i] = 0;
      }
    }
    for (int i = 0; i < TF_EVENTS; ++i) {
      double old = side[i] > 0.0 ? 1.0 : -1.0;
      if (fired[i]) side[i] = s->g[i] * old > 0.0 ? old : s->g[i] == 0.0 ? -0.5 * old : -old;
    }
  }
}
#else
#define TF_MODEL_OF(program, kinds, sides) {program(derivative), 0, 0, TF_GUESSES(program), 0, kinds, sides}
#endif

#if TF_EVENTS
__attribute__((noinline)) /* called at two places */
#else
inline
#endif
static void tf_take(const tf_model* m, tf_steps* s, int method, double t, double end, double h,
                    const tf_number* x, const tf_number* d, const tf_number* p) {
#ifdef TF_VARIABLE
  if (method == TF_DENSE) {
    tf_interpolate(s->variable, end, s->next);
    return;
  }
#endif
  if (method == TF_RK4)
    tf_rk4(m->derivative, s, t, end, h, x, d, p);
  else
    tf_euler(m->derivative, s, t, h, x, d, p);
}

#if TF_EVENTS
/* How far the nearest of the marked indicators is from zero, seen from where it came. */
static double tf_distance(const tf_model* m, const double* g, const tf_number* d) {
  const double *side = d + m->sides, *fired = side + TF_EVENTS;
  double nearest = INFINITY;
  for (int i = 0; i < TF_EVENTS; ++i) {
    double distance = side[i] > 0.0 ? g[i] : -g[i];
    if (fired[i] && m->kinds[i] != 2 && distance < nearest) nearest = distance;
  }
  return nearest;
}

/* Find the first of the marked events within a step from t: Illinois' variant of the false position, every
   fourth time by halves. Returns its time; the state is that at it. */
static double tf_locate(const tf_model* m, tf_stepper* s, int method, double t, double end,
                        const tf_number* x, tf_number* d, const tf_number* p) {
  const double *side = d + m->sides, *fired = side + TF_EVENTS;
  double low = t, high = end, a = tf_distance(m, s->start, d), b = tf_distance(m, s->g, d);
  double width = 4 * TF_PLACE * (tf_size_of(t) > tf_size_of(end) ? tf_size_of(t) : tf_size_of(end));
  int kept = 0;
  if (b == INFINITY) return end; /* times only */
  for (int turn = 1; high - low > width; ++turn) {
    double middle = low + (high - low) / 2;
    if (turn % 4 && a > 0.0 && b < 0.0) {
      middle = low + (high - low) * (a / (a - b));
      if (middle < low + width / 2) middle = low + width / 2;
      if (middle > high - width / 2) middle = high - width / 2;
    }
    tf_take(m, &s->steps, method, t, middle, middle - t, x, d, p);
    m->indicators(&middle, s->steps.next, d, p, s->g);
    int happens = 0;
    for (int i = 0; i < TF_EVENTS; ++i)
      if (fired[i] && m->kinds[i] != 2) happens |= tf_happens(m->kinds[i], side[i], s->g[i], middle);
    if (happens) {
      high = middle, b = tf_distance(m, s->g, d);
      if (kept == 1) a /= 2;
      kept = 1;
    } else {
      low = middle, a = tf_distance(m, s->g, d);
      if (kept == -1) b /= 2;
      kept = -1;
    }
  }
  if (high < end) tf_take(m, &s->steps, method, t, high, high - t, x, d, p);
  return high;
}
#endif

/* Go from *t to `end`, h later, in place, with the events on the way; `fresh` says that d or p may have
   changed since. Stops at the first event if `once`. *t is then where it stands. */
static int tf_between(const tf_model* m, tf_stepper* s, int method, double* t, double end, double h,
                      int fresh, int once, tf_number* x, tf_number* d, const tf_number* p) {
#if TF_EVENTS
  const double whole = h;
  int fault = TF_FINE;
  s->count = 0;
  if (fresh) {
    if (!tf_indicate(m, s, *t, x, d, p)) return TF_BAD_INDICATOR;
    if ((fault = tf_settle(m, s, *t, whole, 0, x, d, p)) != TF_FINE) return fault;
  }
  while (*t < end) {
    double stop = end;
    memcpy(s->start, s->g, TF_EVENTS * sizeof(tf_number));
    for (int i = 0; i < TF_EVENTS; ++i)
      if (m->kinds[i] == 2 && s->g[i] < stop) stop = s->g[i];
    tf_take(m, &s->steps, method, *t, stop, stop < end ? stop - *t : h, x, d, p);
    if (!tf_finite(s->steps.next, TF_X)) return TF_BAD_STATE;
    if (!tf_indicate(m, s, stop, s->steps.next, d, p)) return TF_BAD_INDICATOR;
    int event = tf_mark(m, s, stop, d);
    if (event) {
      stop = tf_locate(m, s, method, *t, stop, x, d, p);
      if (!tf_indicate(m, s, stop, s->steps.next, d, p)) return TF_BAD_INDICATOR;
    }
    memcpy(x, s->steps.next, TF_X * sizeof(tf_number));
    *t = stop;
    if ((fault = tf_settle(m, s, stop, whole, 1, x, d, p)) != TF_FINE) return fault;
    if ((fault = tf_keep(m, stop, x, d, p)) != TF_FINE) return fault;
    if (event && once) return TF_FINE;
    h = end - stop;
  }
  return TF_FINE;
#else
  (void)fresh, (void)once;
  tf_take(m, &s->steps, method, *t, end, h, x, d, p);
  if (!tf_finite(s->steps.next, TF_X)) return TF_BAD_STATE;
  memcpy(x, s->steps.next, TF_X * sizeof(tf_number));
  *t = end;
  return tf_keep(m, end, x, d, p);
#endif
}
