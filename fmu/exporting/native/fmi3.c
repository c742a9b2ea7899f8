/* The functions of FMI 3.0 for model exchange and co-simulation. A variable is an array: its value
   reference is that of its first element, and tf_size holds how many elements follow. */

#include "fmi3Functions.h"

#define INSTANCE(function, phases)                                                              \
  tf_instance* c = instance;                                                                    \
  if (!c) return fmi3Error;                                                                     \
  if (!tf_allowed(c, #function, phases)) return fmi3Error

static fmi3Status tf_fmi3(tf_status status) {
  static const fmi3Status named[] = {fmi3OK, fmi3Warning, fmi3Discard, fmi3Error};
  return named[status];
}

static void tf_emit(tf_instance* c, tf_status status, const char* text) {
  fmi3LogMessageCallback logger = (fmi3LogMessageCallback)c->logger;
  if (logger) logger(c->environment, tf_fmi3(status), "logStatus", text);
}

const char* fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t n,
                               const fmi3String categories[]) {
  INSTANCE(fmi3SetDebugLogging, TF_ANY);
  (void)n, (void)categories;
  c->logging = on;
  return fmi3OK;
}

static tf_instance* tf_instantiate(fmi3String name, fmi3String token, int model_exchange,
                                   int logging, void* environment, fmi3LogMessageCallback logger,
                                   const char* fault) {
  tf_instance shown = {.name = "", .environment = environment, .logger = (void*)logger};
  if (!token || strcmp(token, TF_TOKEN))
    fault = "cannot instantiate: the instantiation token is not that of this binary, so the model "
            "description is of another export";
  tf_instance* c = fault ? NULL : tf_create(name ? name : "", model_exchange, logging);
  if (!c) {
    tf_emit(&shown, TF_ERROR, fault ? fault : "cannot instantiate: out of memory");
    return NULL;
  }
  c->environment = environment;
  c->logger = (void*)logger;
  return c;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                          fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback logger) {
  (void)resources, (void)visible;
  return tf_instantiate(name, token, 1, logging, environment, logger, NULL);
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
    const fmi3ValueReference intermediate[], size_t n, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback logger, fmi3IntermediateUpdateCallback update) {
  const char* fault = NULL;
  (void)resources, (void)visible, (void)early_return, (void)intermediate, (void)update;
  if (event_mode) fault = "cannot instantiate: this FMU has no event mode in co-simulation";
  if (n) fault = "cannot instantiate: this FMU offers no intermediate update";
  return tf_instantiate(name, token, 0, logging, environment, logger, fault);
}

void fmi3FreeInstance(fmi3Instance instance) { tf_free(instance); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean has_tolerance,
                                       fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean has_stop, fmi3Float64 stop) {
  INSTANCE(fmi3EnterInitializationMode, TF_INSTANTIATED);
  (void)has_tolerance, (void)tolerance;
  tf_status status = tf_start(c, start, has_stop, stop);
  if (status == TF_OK) c->s.phase = TF_INITIALIZATION;
  return tf_fmi3(status);
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) {
  INSTANCE(fmi3ExitInitializationMode, TF_INITIALIZATION);
  return tf_fmi3(tf_leave_initialization(c));
}

fmi3Status fmi3Terminate(fmi3Instance instance) {
  INSTANCE(fmi3Terminate, TF_INITIALIZED);
  c->s.phase = TF_TERMINATED;
  return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance instance) {
  INSTANCE(fmi3Reset, TF_ANY);
  tf_reset(c);
  return fmi3OK;
}

/* -- variables ------------------------------------------------------------------------------ */

/* Check that references are known and that their elements are as many as the values. */
static tf_status tf_check_sizes(tf_instance* c, const char* function,
                                const fmi3ValueReference references[], size_t n, size_t values) {
  size_t total = 0;
  for (size_t i = 0; i < n; ++i) {
    if (references[i] >= TF_VR_END || !tf_size[references[i]])
      return tf_unknown(c, function, references[i]);
    total += tf_size[references[i]];
  }
  if (total != values)
    return tf_refuse(c, TF_ERROR, "%s: the variables have %zu elements, but %zu values are given",
                     function, total, values);
  return TF_OK;
}

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference references[], size_t n,
                          fmi3Float64 values[], size_t size) {
  INSTANCE(fmi3GetFloat64, TF_READABLE);
  tf_status status = tf_check_sizes(c, "fmi3GetFloat64", references, n, size);
  if (status != TF_OK) return tf_fmi3(status);
  for (size_t i = 0; i < n; ++i) {
    tf_read(c, references[i], tf_size[references[i]], values);
    values += tf_size[references[i]];
  }
  return fmi3OK;
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference references[], size_t n,
                          const fmi3Float64 values[], size_t size) {
  INSTANCE(fmi3SetFloat64, TF_INSTANTIATED | TF_INITIALIZATION | TF_INITIALIZED);
  tf_status status = tf_check_sizes(c, "fmi3SetFloat64", references, n, size);
  const double* value = values;
  for (size_t i = 0; i < n && status == TF_OK; ++i) {
    status = tf_may_write(c, references[i], tf_size[references[i]], value);
    value += tf_size[references[i]];
  }
  if (status != TF_OK) return tf_fmi3(status);
  for (size_t i = 0; i < n; ++i) {
    tf_write(c, references[i], tf_size[references[i]], values);
    values += tf_size[references[i]];
  }
  return fmi3OK;
}

/* -- saved states --------------------------------------------------------------------------- */

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState* state) {
  INSTANCE(fmi3GetFMUState, TF_ANY);
  return tf_fmi3(tf_save(c, state));
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state) {
  INSTANCE(fmi3SetFMUState, TF_ANY);
  return tf_fmi3(tf_restore(c, state));
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState* state) {
  INSTANCE(fmi3FreeFMUState, TF_ANY);
  if (state) {
    free(*state);
    *state = NULL;
  }
  return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t* size) {
  INSTANCE(fmi3SerializedFMUStateSize, TF_ANY);
  (void)state;
  *size = TF_SERIALIZED;
  return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[],
                                 size_t size) {
  INSTANCE(fmi3SerializeFMUState, TF_ANY);
  return tf_fmi3(tf_pack(c, state, bytes, size));
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size,
                                   fmi3FMUState* state) {
  INSTANCE(fmi3DeserializeFMUState, TF_ANY);
  return tf_fmi3(tf_unpack(c, bytes, size, state));
}

/* -- derivatives ---------------------------------------------------------------------------- */

/* Write the value references of all elements of arrays one after the other. */
static unsigned* tf_spread(unsigned* to, const fmi3ValueReference references[], size_t n) {
  for (size_t i = 0; i < n; ++i)
    for (unsigned k = 0; k < tf_size[references[i]]; ++k) *to++ = references[i] + k;
  return to;
}

static fmi3Status tf_derivative(tf_instance* c, const char* function, int adjoint,
                                const fmi3ValueReference unknowns[], size_t nu,
                                const fmi3ValueReference knowns[], size_t nk,
                                const double seed[], size_t seeds, double result[],
                                size_t results) {
  tf_status status =
      tf_check_sizes(c, function, unknowns, nu, adjoint ? seeds : results);
  if (status == TF_OK)
    status = tf_check_sizes(c, function, knowns, nk, adjoint ? results : seeds);
  if (status != TF_OK) return tf_fmi3(status);
  size_t many = adjoint ? seeds : results, few = adjoint ? results : seeds;
  unsigned* unknown = malloc((many + few + 1) * sizeof *unknown);
  if (!unknown) return tf_fmi3(tf_refuse(c, TF_ERROR, "out of memory"));
  unsigned* known = tf_spread(unknown, unknowns, nu);
  tf_spread(known, knowns, nk);
  status = (adjoint ? tf_adjoint : tf_directional)(c, unknown, many, known, few, seed, result);
  free(unknown);
  return tf_fmi3(status);
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[],
                                        size_t nu, const fmi3ValueReference knowns[], size_t nk,
                                        const fmi3Float64 seed[], size_t seeds,
                                        fmi3Float64 sensitivity[], size_t n) {
  INSTANCE(fmi3GetDirectionalDerivative, TF_INITIALIZATION | TF_INITIALIZED | TF_TERMINATED);
  return tf_derivative(c, "fmi3GetDirectionalDerivative", 0, unknowns, nu, knowns, nk, seed, seeds,
                       sensitivity, n);
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[],
                                    size_t nu, const fmi3ValueReference knowns[], size_t nk,
                                    const fmi3Float64 seed[], size_t seeds,
                                    fmi3Float64 sensitivity[], size_t n) {
  INSTANCE(fmi3GetAdjointDerivative, TF_INITIALIZATION | TF_INITIALIZED | TF_TERMINATED);
  return tf_derivative(c, "fmi3GetAdjointDerivative", 1, unknowns, nu, knowns, nk, seed, seeds,
                       sensitivity, n);
}

/* -- modes ---------------------------------------------------------------------------------- */

fmi3Status fmi3EnterEventMode(fmi3Instance instance) {
  INSTANCE(fmi3EnterEventMode, TF_EVENT | TF_CONTINUOUS);
  if (c->s.phase == TF_CONTINUOUS) tf_enter_event(c);
  return fmi3OK;
}

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance) {
  INSTANCE(fmi3EvaluateDiscreteStates, TF_INITIALIZATION | TF_EVENT);
  return fmi3OK; /* outputs are computed when they are read */
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean* again,
                                    fmi3Boolean* terminate, fmi3Boolean* nominals_changed,
                                    fmi3Boolean* states_changed, fmi3Boolean* has_next,
                                    fmi3Float64* next) {
  INSTANCE(fmi3UpdateDiscreteStates, TF_EVENT);
  tf_plan_event(c);
  *again = *terminate = *nominals_changed = *states_changed = fmi3False;
  *has_next = isfinite(c->next_event);
  *next = *has_next ? c->next_event : 0;
  return fmi3OK;
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance) {
  INSTANCE(fmi3EnterContinuousTimeMode, TF_EVENT);
  return tf_fmi3(tf_enter_continuous(c));
}

/* -- model exchange ------------------------------------------------------------------------- */

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean no_set,
                                       fmi3Boolean* enter_event, fmi3Boolean* terminate) {
  INSTANCE(fmi3CompletedIntegratorStep, TF_CONTINUOUS);
  (void)no_set;
  *enter_event = *terminate = fmi3False;
  return fmi3OK;
}

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time) {
  INSTANCE(fmi3SetTime, TF_EVENT | TF_CONTINUOUS);
  return tf_fmi3(tf_set_time(c, time));
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 x[], size_t n) {
  INSTANCE(fmi3SetContinuousStates, TF_EVENT | TF_CONTINUOUS);
  return tf_fmi3(tf_set_states(c, x, n));
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 rates[],
                                             size_t n) {
  INSTANCE(fmi3GetContinuousStateDerivatives, TF_READABLE);
  return tf_fmi3(tf_rates(c, rates, n));
}

fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 indicators[], size_t n) {
  INSTANCE(fmi3GetEventIndicators, TF_READABLE);
  (void)indicators;
  return tf_fmi3(tf_indicators(c, n));
}

fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 x[], size_t n) {
  INSTANCE(fmi3GetContinuousStates, TF_READABLE);
  return tf_fmi3(tf_states(c, x, n));
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominal[],
                                             size_t n) {
  INSTANCE(fmi3GetNominalsOfContinuousStates, TF_ANY);
  return tf_fmi3(tf_nominals(c, nominal, n));
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t* n) {
  INSTANCE(fmi3GetNumberOfEventIndicators, TF_ANY);
  *n = 0;
  return fmi3OK;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t* n) {
  INSTANCE(fmi3GetNumberOfContinuousStates, TF_ANY);
  *n = TF_X;
  return fmi3OK;
}

/* -- co-simulation -------------------------------------------------------------------------- */

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 time, fmi3Float64 step,
                      fmi3Boolean no_restore, fmi3Boolean* event, fmi3Boolean* terminate,
                      fmi3Boolean* early, fmi3Float64* last_good) {
  INSTANCE(fmi3DoStep, TF_STEPPING);
  (void)no_restore;
  *event = *terminate = *early = fmi3False;
  /* A discarded call leaves an instance as it was before: FMI 3.0, section 2.2.3. */
  tf_status status = tf_step(c, time, step, 1);
  *last_good = c->s.last_good;
  return tf_fmi3(status);
}
