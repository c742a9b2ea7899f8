/* Fixed-step integration and sampling around the programs of a plan.

   This file is the last part of the generated source, after the programs, fixed_step.h and events.h, so
   that the compiler sees everything and can inline. The macros TF_X and TF_D (sizes of x and d),
   TF_OUTPUTS (whether there is a logged vector), TF_SAMPLES and TF_PROGRAMS (lists of programs), and those
   of events.h are defined by the code that writes the source. */

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
   it returns 0 if it failed. Both are null without Python blocks.

   Returns the number of steps taken; *fault is 0, or why it stopped: see events.h. */
TF_EXPORT long long tf_advance(void* work, int method, double numerator, double denominator,
                               long long first, long long number, tf_number* x, tf_number* d,
                               const tf_number* p, const unsigned short* due,
                               const unsigned char* logged, tf_number* log, long long log_width,
                               int* fault, tf_number* bad, const signed char* kinds, int sides,
                               const unsigned char* python, tf_instant instant) {
  tf_work* s = (tf_work*)work;
  const tf_model model = TF_MODEL_OF(TF_RUN, kinds, sides);
  double h = numerator / denominator, next = (double)first * numerator / denominator;
  *fault = 0;
  for (long long k = 0; k < number; ++k) {
    double t = next;
    next = (double)(first + k + 1) * numerator / denominator;
    if (due[k] && python && python[due[k]]) {
      if (!instant(k)) return k;
    } else if (due[k]) {
      tf_samples[due[k]](&t, x, d, p, s->d_next);
      if (!tf_sound(s->d_next)) {
        tf_report(s, *fault = TF_BAD_D, s->d_next, bad);
        return k;
      }
      memcpy(d, s->d_next, TF_D * sizeof(tf_number));
    }
#if TF_OUTPUTS
    if (logged[k]) {
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
