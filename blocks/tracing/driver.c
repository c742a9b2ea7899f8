/* Fixed-step integration and sampling around the programs of a plan.

   This file is the last part of the generated source, after the programs, fixed_step.h and events.h, so
   that the compiler sees everything and can inline. The macros TF_X and TF_D (sizes of x and d),
   TF_BLOCKS (number of continuous Python blocks), TF_OUTPUTS (whether there is a logged vector), TF_SAMPLES and
   TF_PROGRAMS (lists of programs), and those of events.h are defined by the code that writes the source. */

#if defined(_WIN32)
#define TF_EXPORT __declspec(dllexport)
#else
#define TF_EXPORT __attribute__((visibility("default")))
#endif

typedef struct {
  tf_stepper stepper;
  tf_number d_next[TF_D + 1];
#ifdef TF_VARIABLE
  tf_variable variable;
#endif
} tf_work;

typedef int (*tf_instant)(long long);

static const tf_program tf_samples[] = {0 TF_SAMPLES};

/* The programs in the order in which the plan traced them. */
static const tf_program tf_programs[] = {TF_PROGRAMS};

TF_EXPORT long long tf_work_size(void) { return (long long)sizeof(tf_work); }

TF_EXPORT void tf_evaluate(int number, double t, const tf_number* x, const tf_number* d, const tf_number* p,
                           tf_number* result) {
  tf_programs[number](&t, x, d, p, result);
}

#if TF_BLOCKS && TF_EVENTS && !defined(TF_VARIABLE)
/* A function of an FMU and its arguments after the instance. With the calling conventions of all machines that have
   FMUs, a function with fewer arguments ignores the last ones. */
typedef struct {
  int (*function)(void*, void*, size_t, void*, size_t);
  void* a;
  size_t n; /* 0: not called, except to set the time */
  void* b;
  size_t m;
} tf_call;

enum { TF_SET_TIME, TF_SET_STATES, TF_SET_INPUTS, TF_GET_OUTPUTS, TF_RATES, TF_SIGNS, TF_COMPLETED, TF_CALLS };

/* A continuous Python block that is an FMU for model exchange. */
typedef struct {
  size_t program, x, d, g; /* program of its inputs; places of its states, outputs and indicators */
  /* the words of `LoadedModelExchange.compiled` */
  void* instance;
  tf_call calls[TF_CALLS];
  const long long *written, *read; /* places of the inputs that are set, and of the outputs that are got */
  const unsigned char* continuous; /* inputs that may change between events */
  double* u;                       /* inputs */
  double* times; /* present time, of the last accepted point, of the next time event; inputs at the second of them */
  int* flags; /* an event is requested, the end of the run; status and number of the call that failed */
  size_t inputs_size, written_size, read_size;
} tf_block;

/* The blocks in sorted order; programs have no argument for them. */
static _Thread_local tf_block* tf_blocks;

#define TF_EACH(b) for (tf_block* b = tf_blocks; b < tf_blocks + TF_BLOCKS; ++b)

static void tf_enter(tf_block* blocks) {
  tf_blocks = blocks;
  TF_EACH(b) b->times[0] = NAN; /* Python may have set another point */
}

/* Call a function of an FMU; after an error FMI forbids all calls. */
static void tf_do(const tf_block* b, int number) {
  const tf_call* c = b->calls + number;
  if (b->flags[2] || (number != TF_SET_TIME && !c->n)) return;
  int status = number == TF_SET_TIME ? ((int (*)(void*, double))c->function)(b->instance, b->times[0])
                                     : c->function(b->instance, c->a, c->n, c->b, c->m);
  if (status > 1) b->flags[2] = status, b->flags[3] = number;
}

static int tf_failed(void) {
  int failed = 0;
  TF_EACH(b) failed |= b->flags[2];
  return failed;
}

/* Set time, states and inputs of a block, unless it has them. */
static void tf_place(const tf_block* b, double t, const double* x, const double* d, const double* p) {
  const tf_call* states = b->calls + TF_SET_STATES;
  double* inputs = b->calls[TF_SET_INPUTS].b;
  int same = t == b->times[0] && !memcmp(states->a, x + b->x, states->n * sizeof *x);
  tf_programs[b->program](&t, x, d, p, b->u);
  for (size_t i = 0; i < b->written_size; ++i) {
    same &= !memcmp(inputs + i, b->u + b->written[i], sizeof *inputs);
    inputs[i] = b->u[b->written[i]];
  }
  if (same) return;
  b->times[0] = t;
  memcpy(states->a, x + b->x, states->n * sizeof *x);
  for (int i = TF_SET_TIME; i <= TF_SET_INPUTS; ++i) tf_do(b, i);
}

/* Put the outputs of all blocks into d; return whether a call failed. The twin in Python, also of the next functions,
   is `PythonExecutor`. */
static int tf_refresh(double t, const double* x, double* d, const double* p) {
  TF_EACH(b) {
    const double* outputs = b->calls[TF_GET_OUTPUTS].b;
    tf_place(b, t, x, d, p);
    tf_do(b, TF_GET_OUTPUTS);
    for (size_t i = 0; i < b->read_size; ++i) d[b->d + b->read[i]] = outputs[i];
  }
  return tf_failed();
}

/* Place a block, and put its derivatives or indicators into those of all. */
static void tf_add(const tf_block* b, int number, double t, const double* x, const double* d, const double* p,
                   double* into) {
  const tf_call* c = b->calls + number;
  tf_place(b, t, x, d, p);
  tf_do(b, number);
  memcpy(into, c->a, c->n * sizeof *into);
}

static void tf_all_derivatives(const double* t, const double* x, const double* d, const double* p, double* result) {
  tf_refresh(*t, x, (double*)d, p);
  tf_run_derivative(t, x, d, p, result);
  TF_EACH(b) tf_add(b, TF_RATES, *t, x, d, p, result + b->x);
}

static void tf_all_indicators(const double* t, const double* x, const double* d, const double* p, double* result) {
  tf_refresh(*t, x, (double*)d, p);
  tf_run_indicators(t, x, d, p, result);
  TF_EACH(b) {
    double* next_time = result + b->g + b->calls[TF_SIGNS].n;
    tf_add(b, TF_SIGNS, *t, x, d, p, result + b->g);
    *next_time = b->times[2];
    for (size_t i = 0; i < b->inputs_size; ++i) /* inputs that jump cause an event */
      if (b->times[1] >= *t && b->u[i] != b->times[3 + i]) *next_time = -INFINITY;
  }
}

/* Take a step without events, with the arguments of tf_between. A step with an event is left to Python; if a block
   requests an event at its end, only that event is. */
static int tf_step_blocks(const tf_model* m, tf_stepper* s, int method, double* t, double end, double h, int fresh,
                          int once, double* x, double* d, const double* p) {
  tf_model all = *m;
  int requested = 0;
  all.derivative = tf_all_derivatives, all.indicators = tf_all_indicators;
  TF_EACH(b) if (b->flags[1]) return TF_PYTHON;
  if (fresh) {
    if (!tf_indicate(&all, s, *t, x, d, p) || tf_mark(&all, s, *t, d)) return TF_PYTHON;
    tf_settle(&all, s, *t, h, 0, x, d, p);
  }
  for (int i = 0; i < TF_EVENTS; ++i)
    if (m->kinds[i] == 2 && s->g[i] < end) return TF_PYTHON;
  tf_take(&all, &s->steps, method, *t, end, h, x, d, p);
  if (!tf_finite(s->steps.next, TF_X) || !tf_indicate(&all, s, end, s->steps.next, d, p) ||
      tf_mark(&all, s, end, d) || tf_failed())
    return TF_PYTHON;
  TF_EACH(b) {
    tf_do(b, TF_COMPLETED);
    for (size_t i = 0; i < b->inputs_size; ++i) b->flags[0] |= !b->continuous[i] && b->u[i] != b->times[3 + i];
    memcpy(b->times + 3, b->u, b->inputs_size * sizeof *b->u);
    b->times[1] = end;
    requested |= b->flags[0];
  }
  memcpy(x, s->steps.next, TF_X * sizeof *x);
  if (requested || tf_failed()) return TF_PYTHON;
  *t = end;
  tf_settle(&all, s, end, h, once, x, d, p);
  return tf_keep(m, end, x, d, p);
}

#define tf_between tf_step_blocks /* in tf_advance */
#else
typedef void tf_block;
#define tf_enter(blocks) (void)(blocks)
#define tf_refresh(t, x, d, p) 0
#endif

/* Copy to `bad` what is not finite, as `fault` says. */
static void tf_report(const tf_work* s, int fault, const tf_number* d, tf_number* bad) {
  if (fault == TF_BAD_STATE) memcpy(bad, s->stepper.steps.next, TF_X * sizeof(tf_number));
  if (fault == TF_BAD_D) memcpy(bad, d, TF_D * sizeof(tf_number));
  if (fault == TF_BAD_INDICATOR) memcpy(bad, s->stepper.g, TF_EVENTS * sizeof(tf_number));
}

/* Take steps first, first+1, ... (number of them) of one tick each, which is the fraction
   numerator/denominator: so the time of step 9 of 0.1 s is the number that 0.9 stands for, where
   9 * 0.1 may round to another. At the start of each step, sample where `due` says so (0: no;
   i: the i-th sample function) and log where `logged` says so. Stops before a step or sample
   whose result is not finite. For `kinds` and `sides` see events.h.

   `python` marks the sample functions in place of which `instant` computes in Python, given the index of the step;
   it returns 0 if it failed. Both are null without Python blocks. `blocks` are the continuous ones.

   Returns the number of steps taken; *fault is 0, or why it stopped: see events.h. */
TF_EXPORT long long tf_advance(void* work, int method, double numerator, double denominator,
                               long long first, long long number, tf_number* x, tf_number* d,
                               const tf_number* p, const unsigned short* due,
                               const unsigned char* logged, tf_number* log, long long log_width,
                               int* fault, tf_number* bad, const signed char* kinds, int sides,
                               const unsigned char* python, tf_instant instant, tf_block* blocks) {
  tf_work* s = (tf_work*)work;
  const tf_model model = TF_MODEL_OF(TF_RUN, kinds, sides);
  double h = numerator / denominator, next = (double)first * numerator / denominator;
  *fault = 0;
  tf_enter(blocks);
  for (long long k = 0; k < number; ++k) {
    double t = next;
    next = (double)(first + k + 1) * numerator / denominator;
    if (due[k] && python && python[due[k]]) {
      if (!instant(k)) return k;
      tf_enter(blocks);
    } else if (due[k]) {
      if (tf_refresh(t, x, d, p)) {
        *fault = TF_BAD_D;
        return k;
      }
      tf_samples[due[k]](&t, x, d, p, s->d_next);
      if (!tf_sound(s->d_next)) {
        tf_report(s, *fault = TF_BAD_D, s->d_next, bad);
        return k;
      }
      memcpy(d, s->d_next, TF_D * sizeof(tf_number));
    }
#if TF_OUTPUTS
    if (logged[k]) {
      if (tf_refresh(t, x, d, p)) {
        *fault = TF_BAD_D;
        return k;
      }
      tf_run_outputs(&t, x, d, p, log);
      log += log_width;
    }
#endif
    *fault = tf_between(&model, &s->stepper, method, &t, next, h, due[k] || !k, 0, x, d, p);
    if (*fault) {
      tf_report(s, *fault, d, bad);
      if (*fault == TF_ENDLESS || *fault == TF_BAD_LOOP || *fault == TF_ENDED || *fault == TF_FULL)
        bad[0] = t + (tf_number){0};
      return k;
    }
  }
  return number;
}

#ifdef TF_VARIABLE
/* Advance by variable steps as `control` says: log at `times` in turn, and return when the end of the span, the
   number of steps or that of rows is reached. Its field `begun` is 0 if d or p may have changed since; `fault`
   is 0, or why it stopped. */
TF_EXPORT void tf_vary(void* work, tf_control* control, tf_number* x, tf_number* d, const tf_number* p,
                       const double* times, tf_number* log, long long log_width, int* fault, tf_number* bad,
                       const signed char* kinds, int sides) {
  tf_work* s = (tf_work*)work;
  const tf_model model = TF_MODEL_OF(TF_RUN, kinds, sides);
  tf_variable* v = &s->variable;
  v->derivative = model.derivative;
#if TF_STIFF
  v->tangent = tf_run_tangent;
#endif
  v->control = control, v->x = x, v->d = d, v->p = p;
  v->last = tf_just_before(control->end);
  s->stepper.steps.variable = v;
  *fault = tf_vary_between(&model, &s->stepper, v, x, d, p, times, log, log_width);
  tf_report(s, *fault, d, bad);
  if (*fault == TF_STUCK) memcpy(bad, v->stage, TF_X * sizeof(tf_number));
}
#endif
