/* Fixed-step integration and sampling around the programs of a plan.

   This file is the last part of the generated source, after the programs and fixed_step.h, so that
   the compiler sees everything and can inline. The macros TF_X and TF_D (sizes of x and d),
   TF_OUTPUTS (whether there is a logged vector), TF_SAMPLES and TF_PROGRAMS (lists of programs) are
   defined by the code that writes the source. */

#if defined(_WIN32)
#define TF_EXPORT __declspec(dllexport)
#else
#define TF_EXPORT __attribute__((visibility("default")))
#endif

typedef struct {
  tf_steps steps;
  double d_next[TF_D + 1];
} tf_work;

static const tf_program tf_samples[] = {0 TF_SAMPLES};

/* The programs in the order in which the plan traced them. */
static const tf_program tf_programs[] = {TF_PROGRAMS};

TF_EXPORT long long tf_work_size(void) { return (long long)sizeof(tf_work); }

TF_EXPORT void tf_evaluate(int number, double t, const double* x, const double* d, const double* p,
                           double* result) {
  tf_programs[number](&t, x, d, p, result);
}

/* Take steps first, first+1, ... (number of them) of one tick each, which is the fraction
   numerator/denominator: so the time of step 9 of 0.1 s is the number that 0.9 stands for, where
   9 * 0.1 may round to another. At the start of each step, sample where `due` says so (0: no;
   i: the i-th sample function) and log where `logged` says so. Stops before a step or sample
   whose result is not finite.

   Returns the number of steps taken; *fault is 0, or 1 for a state, 2 for a sampled value. */
TF_EXPORT long long tf_advance(void* work, int method, double numerator, double denominator,
                               long long first, long long number, double* x, double* d,
                               const double* p, const unsigned short* due,
                               const unsigned char* logged, double* log, long long log_width,
                               int* fault, double* bad) {
  tf_work* s = (tf_work*)work;
  double h = numerator / denominator, next = (double)first * numerator / denominator;
  *fault = 0;
  for (long long k = 0; k < number; ++k) {
    double t = next;
    next = (double)(first + k + 1) * numerator / denominator;
    if (due[k]) {
      tf_samples[due[k]](&t, x, d, p, s->d_next);
      if (!tf_finite(s->d_next, TF_D)) {
        memcpy(bad, s->d_next, TF_D * sizeof(double));
        *fault = 2;
        return k;
      }
      memcpy(d, s->d_next, TF_D * sizeof(double));
    }
#if TF_OUTPUTS
    if (logged[k]) {
      tf_run_outputs(&t, x, d, p, log);
      log += log_width;
    }
#endif
    if (method)
      tf_rk4(tf_run_derivative, &s->steps, t, next, h, x, d, p);
    else
      tf_euler(tf_run_derivative, &s->steps, t, h, x, d, p);
    if (!tf_finite(s->steps.next, TF_X)) {
      memcpy(bad, s->steps.next, TF_X * sizeof(double));
      *fault = 1;
      return k;
    }
    memcpy(x, s->steps.next, TF_X * sizeof(double));
  }
  return number;
}
