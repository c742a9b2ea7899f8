/* Functions that exist in FMI 3.0 only, or whose arguments differ from FMI 2.0. A variable is an array:
   its value reference is that of its first element, and tf_size is its number of elements. */

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                          fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback logger) {
  return tf_instantiate(name, token, 1, logging, environment, (void*)logger, NULL);
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
    const fmi3ValueReference intermediate[], size_t n, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback logger, fmi3IntermediateUpdateCallback update) {
  const char* fault = NULL;
  if (event_mode) fault = "cannot instantiate: this FMU has no event mode in co-simulation";
  if (n) fault = "cannot instantiate: this FMU offers no intermediate update";
  tf_instance* c = tf_instantiate(name, token, 0, logging, environment, (void*)logger, fault);
  if (c) c->may_return_early = early_return;
  return c;
}

static tf_status tf_enter_initialization(tf_instance* c, int has_tolerance, double tolerance, double start,
                                         int has_stop, double stop) {
  tf_status status = tf_start(c, has_tolerance, tolerance, start, has_stop, stop);
  return status == TF_OK ? tf_enter(c, TF_INITIALIZATION) : status;
}

FUNCTION(EnterInitializationMode,
         (fmi3Instance instance, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
          fmi3Float64 start, fmi3Boolean has_stop, fmi3Float64 stop),
         TF_INSTANTIATED, tf_enter_initialization(c, has_tolerance, tolerance, start, has_stop, stop))

/* -- variables ------------------------------------------------------------------------------ */

/* Check that references are known and that their number of elements equals that of the values. */
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

static tf_status tf_get_arrays(tf_instance* c, const fmi3ValueReference references[], size_t n,
                               double values[], size_t size) {
  tf_status status = tf_check_sizes(c, "fmi3GetFloat64", references, n, size);
  for (size_t i = 0; i < n && status == TF_OK; values += tf_size[references[i++]])
    tf_read(c, references[i], tf_size[references[i]], values);
  return status;
}

static tf_status tf_set_arrays(tf_instance* c, const fmi3ValueReference references[], size_t n,
                               const double values[], size_t size) {
  tf_status status = tf_check_sizes(c, "fmi3SetFloat64", references, n, size);
  const double* value = values;
  for (size_t i = 0; i < n && status == TF_OK; value += tf_size[references[i++]])
    status = tf_may_write(c, references[i], tf_size[references[i]], value);
  for (size_t i = 0; i < n && status == TF_OK; values += tf_size[references[i++]])
    tf_write(c, references[i], tf_size[references[i]], values);
  return status;
}

FUNCTION(GetFloat64,
         (fmi3Instance instance, const fmi3ValueReference references[], size_t n,
          fmi3Float64 values[], size_t size),
         TF_READABLE, tf_get_arrays(c, references, n, values, size))
FUNCTION(SetFloat64,
         (fmi3Instance instance, const fmi3ValueReference references[], size_t n,
          const fmi3Float64 values[], size_t size),
         TF_INSTANTIATED | TF_INITIALIZATION | TF_INITIALIZED,
         tf_set_arrays(c, references, n, values, size))

/* -- derivatives ---------------------------------------------------------------------------- */

/* Write the concatenated value references of all elements of arrays. */
static unsigned* tf_spread(unsigned* to, const fmi3ValueReference references[], size_t n) {
  for (size_t i = 0; i < n; ++i)
    for (unsigned k = 0; k < tf_size[references[i]]; ++k) *to++ = references[i] + k;
  return to;
}

static tf_status tf_derivative(tf_instance* c, const char* function, int adjoint,
                               const fmi3ValueReference unknowns[], size_t nu,
                               const fmi3ValueReference knowns[], size_t nk, const double seed[],
                               size_t seeds, double result[], size_t results) {
  size_t many = adjoint ? seeds : results, few = adjoint ? results : seeds;
  tf_status status = tf_check_sizes(c, function, unknowns, nu, many);
  if (status == TF_OK) status = tf_check_sizes(c, function, knowns, nk, few);
  if (status != TF_OK) return status;
  unsigned* unknown = malloc((many + few + 1) * sizeof *unknown);
  if (!unknown) return tf_refuse(c, TF_ERROR, "out of memory");
  unsigned* known = tf_spread(unknown, unknowns, nu);
  tf_spread(known, knowns, nk);
  status = (adjoint ? tf_adjoint : tf_directional)(c, unknown, many, known, few, seed, result);
  free(unknown);
  return status;
}

#define DERIVATIVE(name, adjoint)                                                               \
  FUNCTION(name,                                                                                \
           (fmi3Instance instance, const fmi3ValueReference unknowns[], size_t nu,              \
            const fmi3ValueReference knowns[], size_t nk, const fmi3Float64 seed[],             \
            size_t seeds, fmi3Float64 sensitivity[], size_t n),                                 \
           TF_INITIALIZATION | TF_INITIALIZED | TF_TERMINATED,                                  \
           tf_derivative(c, TF_TEXT(FMI(name)), adjoint, unknowns, nu, knowns, nk, seed, seeds, \
                         sensitivity, n))
DERIVATIVE(GetDirectionalDerivative, 0)
DERIVATIVE(GetAdjointDerivative, 1)

/* -- model exchange ------------------------------------------------------------------------- */

/* Nothing to do: outputs are computed when they are read. */
FUNCTION(EvaluateDiscreteStates, (fmi3Instance instance), TF_INITIALIZATION | TF_EVENT, TF_OK)

static tf_status tf_update(tf_instance* c, fmi3Boolean* terminate, fmi3Boolean* states_changed,
                           fmi3Boolean* has_next, fmi3Float64* next) {
  int jumped;
  if (tf_handle(c, &jumped) != TF_OK) return TF_ERROR;
  /* tf_handle iterates to convergence, so no further update is requested. */
  *states_changed = jumped;
  *terminate = c->s.ended;
  tf_plan_event(c);
  *has_next = isfinite(c->next_event);
  *next = *has_next ? c->next_event : 0;
  return TF_OK;
}

FUNCTION(UpdateDiscreteStates,
         (fmi3Instance instance, fmi3Boolean* again, fmi3Boolean* terminate,
          fmi3Boolean* nominals_changed, fmi3Boolean* states_changed, fmi3Boolean* has_next,
          fmi3Float64* next),
         TF_EVENT,
         (*again = *nominals_changed = fmi3False,
          tf_update(c, terminate, states_changed, has_next, next)))
FUNCTION(GetNumberOfEventIndicators, (fmi3Instance instance, size_t* n), TF_ANY,
         (*n = TF_INDICATORS, TF_OK))
FUNCTION(GetNumberOfContinuousStates, (fmi3Instance instance, size_t* n), TF_ANY,
         (*n = TF_X, TF_OK))

/* -- co-simulation -------------------------------------------------------------------------- */

static tf_status tf_do_step(tf_instance* c, double time, double step, fmi3Boolean* terminate,
                            fmi3Boolean* early, fmi3Float64* last_good) {
  /* A discarded call must not change the instance: FMI 3.0, section 2.2.3. */
  tf_status status = tf_communication_step(c, time, step, 1);
  *terminate = c->s.ended;
  *last_good = c->s.last_good;
  /* Without consent to early returns, only *terminate tells that the step is incomplete. */
  *early = status == TF_OK && c->may_return_early && c->s.last_good < time + step - tf_same(time + step);
  return status;
}

FUNCTION(DoStep,
         (fmi3Instance instance, fmi3Float64 time, fmi3Float64 step, fmi3Boolean no_restore,
          fmi3Boolean* event, fmi3Boolean* terminate, fmi3Boolean* early, fmi3Float64* last_good),
         TF_STEPPING,
         (*event = fmi3False, tf_do_step(c, time, step, terminate, early, last_good)))
