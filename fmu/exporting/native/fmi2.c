/* Functions that exist in FMI 2.0 only, or whose arguments differ from FMI 3.0. */

const char* fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token,
                              fmi2String resources, const fmi2CallbackFunctions* functions,
                              fmi2Boolean visible, fmi2Boolean logging) {
  return tf_instantiate(
      name, token, type == fmi2ModelExchange, logging,
      functions ? functions->componentEnvironment : NULL,
      functions ? (void*)functions->logger : NULL,
      name && *name ? NULL : "cannot instantiate: the instance needs a name");
}

FUNCTION(SetupExperiment,
         (fmi2Component instance, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
          fmi2Boolean has_stop, fmi2Real stop),
         TF_INSTANTIATED, tf_start(c, has_tolerance, tolerance, start, has_stop, stop))
FUNCTION(EnterInitializationMode, (fmi2Component instance), TF_INSTANTIATED,
         tf_enter(c, TF_INITIALIZATION))

/* -- variables ------------------------------------------------------------------------------ */

/* Return the number of leading value references that are consecutive. */
static unsigned tf_run(const fmi2ValueReference* references, size_t n) {
  unsigned run = 1;
  while (run < n && references[run] == references[0] + run) ++run;
  return run;
}

static tf_status tf_get_real(tf_instance* c, const fmi2ValueReference references[], size_t n,
                             fmi2Real values[]) {
  for (size_t i = 0; i < n; ++i)
    if (!references[i] || references[i] >= TF_VR_END)
      return tf_unknown(c, "fmi2GetReal", references[i]);
  for (size_t i = 0, run; i < n; i += run) {
    run = tf_run(references + i, n - i);
    tf_read(c, references[i], (unsigned)run, values + i);
  }
  return TF_OK;
}

static tf_status tf_set_real(tf_instance* c, const fmi2ValueReference references[], size_t n,
                             const fmi2Real values[]) {
  for (size_t i = 0; i < n; ++i) {
    if (!references[i] || references[i] >= TF_VR_END)
      return tf_unknown(c, "fmi2SetReal", references[i]);
    tf_status status = tf_may_write(c, references[i], 1, values + i);
    if (status != TF_OK) return status;
  }
  for (size_t i = 0, run; i < n; i += run) {
    run = tf_run(references + i, n - i);
    tf_write(c, references[i], (unsigned)run, values + i);
  }
  return TF_OK;
}

FUNCTION(GetReal,
         (fmi2Component instance, const fmi2ValueReference references[], size_t n,
          fmi2Real values[]),
         TF_READABLE, tf_get_real(c, references, n, values))
FUNCTION(SetReal,
         (fmi2Component instance, const fmi2ValueReference references[], size_t n,
          const fmi2Real values[]),
         TF_INSTANTIATED | TF_INITIALIZATION | TF_INITIALIZED,
         tf_set_real(c, references, n, values))
NO_VARIABLES(GetInteger, fmi2Integer values[])
NO_VARIABLES(GetBoolean, fmi2Boolean values[])
NO_VARIABLES(GetString, fmi2String values[])
NO_VARIABLES(SetInteger, const fmi2Integer values[])
NO_VARIABLES(SetBoolean, const fmi2Boolean values[])
NO_VARIABLES(SetString, const fmi2String values[])

FUNCTION(GetDirectionalDerivative,
         (fmi2Component instance, const fmi2ValueReference unknown[], size_t nu,
          const fmi2ValueReference known[], size_t nk, const fmi2Real seed[], fmi2Real result[]),
         TF_INITIALIZATION | TF_INITIALIZED | TF_TERMINATED,
         tf_directional(c, unknown, nu, known, nk, seed, result))

/* -- model exchange ------------------------------------------------------------------------- */

static tf_status tf_new_discrete_states(tf_instance* c, fmi2EventInfo* info) {
  int jumped;
  memset(info, 0, sizeof *info);
  if (tf_handle(c, &jumped) != TF_OK) return TF_ERROR;
  info->valuesOfContinuousStatesChanged = jumped;
  info->terminateSimulation = c->s.ended;
  tf_plan_event(c);
  info->nextEventTimeDefined = isfinite(c->next_event);
  info->nextEventTime = isfinite(c->next_event) ? c->next_event : 0;
  return TF_OK;
}

FUNCTION(NewDiscreteStates, (fmi2Component instance, fmi2EventInfo* info), TF_EVENT,
         tf_new_discrete_states(c, info))

/* -- co-simulation -------------------------------------------------------------------------- */

static tf_status tf_do_step(tf_instance* c, double time, double step) {
  tf_status status = tf_communication_step(c, time, step, 0);
  if (c->s.ended && status == TF_OK) status = TF_DISCARD;
  /* FMI 2: after a discarded step only status queries, a saved state, a reset or the end are allowed. */
  if (status == TF_DISCARD) c->s.phase = TF_FAILED;
  return status;
}

FUNCTION(DoStep,
         (fmi2Component instance, fmi2Real time, fmi2Real step, fmi2Boolean no_restore),
         TF_STEPPING, tf_do_step(c, time, step))
REFUSED(CancelStep, (fmi2Component instance), TF_ERROR,
        "steps are never pending, so none can be cancelled")
FUNCTION(SetRealInputDerivatives,
         (fmi2Component instance, const fmi2ValueReference references[], size_t n,
          const fmi2Integer order[], const fmi2Real value[]),
         TF_ANY, n ? tf_refuse(c, TF_ERROR, "inputs are not interpolated") : TF_OK)
FUNCTION(GetRealOutputDerivatives,
         (fmi2Component instance, const fmi2ValueReference references[], size_t n,
          const fmi2Integer order[], fmi2Real value[]),
         TF_ANY, n ? tf_refuse(c, TF_ERROR, "derivatives of outputs are not offered") : TF_OK)

#define STATUS(type) (fmi2Component instance, const fmi2StatusKind kind, fmi2##type* value)
FUNCTION(GetRealStatus, STATUS(Real), TF_STEPPING | TF_FAILED | TF_TERMINATED,
         kind == fmi2LastSuccessfulTime
             ? (*value = c->s.last_good, TF_OK)
             : tf_refuse(c, TF_DISCARD, "the last successful time is the only real status"))
FUNCTION(GetBooleanStatus, STATUS(Boolean), TF_ANY,
         kind == fmi2Terminated
             ? (*value = c->s.ended, TF_OK)
             : tf_refuse(c, TF_DISCARD, "whether the FMU terminated is the only Boolean status"))
REFUSED(GetStatus, STATUS(Status), TF_DISCARD, "steps are never pending")
REFUSED(GetIntegerStatus, STATUS(Integer), TF_DISCARD, "there is no integer status")
REFUSED(GetStringStatus, STATUS(String), TF_DISCARD, "there is no string status")
