/* The functions of FMI 2.0 for model exchange and co-simulation. */

#undef FMI2_FUNCTION_PREFIX /* a shared library has the plain names, whoever builds it */
#include "fmi2Functions.h"

#define INSTANCE(function, phases)                                                              \
  tf_instance* c = component;                                                                   \
  if (!c) return fmi2Error;                                                                     \
  if (!tf_allowed(c, #function, phases)) return fmi2Error

static fmi2Status tf_fmi2(tf_status status) {
  static const fmi2Status named[] = {fmi2OK, fmi2Warning, fmi2Discard, fmi2Error};
  return named[status];
}

static void tf_emit(tf_instance* c, tf_status status, const char* text) {
  fmi2CallbackLogger logger = (fmi2CallbackLogger)c->logger;
  if (logger) logger(c->environment, c->name, tf_fmi2(status), "logStatus", text);
}

const char* fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char* fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component component, fmi2Boolean on, size_t n,
                               const fmi2String names[]) {
  INSTANCE(fmi2SetDebugLogging, TF_ANY);
  (void)names, (void)n;
  c->logging = on;
  return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token,
                              fmi2String resources, const fmi2CallbackFunctions* functions,
                              fmi2Boolean visible, fmi2Boolean logging) {
  tf_instance shown = {.name = (char*)(name ? name : "")};
  (void)resources, (void)visible;
  if (functions) shown.environment = functions->componentEnvironment;
  if (functions) shown.logger = (void*)functions->logger;
  const char* fault = NULL;
  if (!name || !*name) fault = "cannot instantiate: the instance needs a name";
  if (!token || strcmp(token, TF_TOKEN))
    fault = "cannot instantiate: the GUID is not that of this binary, so the model description "
            "is of another export";
  if (fault) {
    tf_emit(&shown, TF_ERROR, fault);
    return NULL;
  }
  tf_instance* c = tf_create(name, type == fmi2ModelExchange, logging);
  if (!c) {
    tf_emit(&shown, TF_ERROR, "cannot instantiate: out of memory");
    return NULL;
  }
  c->environment = shown.environment;
  c->logger = shown.logger;
  return c;
}

void fmi2FreeInstance(fmi2Component component) { tf_free(component); }

fmi2Status fmi2SetupExperiment(fmi2Component component, fmi2Boolean has_tolerance,
                               fmi2Real tolerance, fmi2Real start, fmi2Boolean has_stop,
                               fmi2Real stop) {
  INSTANCE(fmi2SetupExperiment, TF_INSTANTIATED);
  (void)has_tolerance, (void)tolerance;
  return tf_fmi2(tf_start(c, start, has_stop, stop));
}

fmi2Status fmi2EnterInitializationMode(fmi2Component component) {
  INSTANCE(fmi2EnterInitializationMode, TF_INSTANTIATED);
  c->s.phase = TF_INITIALIZATION;
  return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component component) {
  INSTANCE(fmi2ExitInitializationMode, TF_INITIALIZATION);
  return tf_fmi2(tf_leave_initialization(c));
}

fmi2Status fmi2Terminate(fmi2Component component) {
  INSTANCE(fmi2Terminate, TF_INITIALIZED | TF_FAILED);
  c->s.phase = TF_TERMINATED;
  return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component component) {
  INSTANCE(fmi2Reset, TF_ANY);
  tf_reset(c);
  return fmi2OK;
}

/* -- variables ------------------------------------------------------------------------------ */

/* How many value references from the first on follow each other. */
static unsigned tf_run(const fmi2ValueReference* references, size_t n) {
  unsigned run = 1;
  while (run < n && references[run] == references[0] + run) ++run;
  return run;
}

fmi2Status fmi2GetReal(fmi2Component component, const fmi2ValueReference references[], size_t n,
                       fmi2Real values[]) {
  INSTANCE(fmi2GetReal, TF_READABLE);
  for (size_t i = 0; i < n; ++i)
    if (references[i] >= TF_VR_END) return tf_fmi2(tf_unknown(c, "fmi2GetReal", references[i]));
  for (size_t i = 0, run; i < n; i += run) {
    run = tf_run(references + i, n - i);
    tf_read(c, references[i], (unsigned)run, values + i);
  }
  return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component component, const fmi2ValueReference references[], size_t n,
                       const fmi2Real values[]) {
  INSTANCE(fmi2SetReal, TF_INSTANTIATED | TF_INITIALIZATION | TF_INITIALIZED);
  for (size_t i = 0; i < n; ++i) {
    if (references[i] >= TF_VR_END) return tf_fmi2(tf_unknown(c, "fmi2SetReal", references[i]));
    tf_status status = tf_may_write(c, references[i], 1, values + i);
    if (status != TF_OK) return tf_fmi2(status);
  }
  for (size_t i = 0, run; i < n; i += run) {
    run = tf_run(references + i, n - i);
    tf_write(c, references[i], (unsigned)run, values + i);
  }
  return fmi2OK;
}

/* All variables are real numbers: no reference of another type is known. */
#define NO_VARIABLES(name, type)                                                                \
  fmi2Status name(fmi2Component component, const fmi2ValueReference references[], size_t n,     \
                  type values[]) {                                                              \
    INSTANCE(name, TF_ANY);                                                                     \
    (void)values;                                                                               \
    return n ? tf_fmi2(tf_unknown(c, #name, references[0])) : fmi2OK;                           \
  }
NO_VARIABLES(fmi2GetInteger, fmi2Integer)
NO_VARIABLES(fmi2GetBoolean, fmi2Boolean)
NO_VARIABLES(fmi2GetString, fmi2String)
NO_VARIABLES(fmi2SetInteger, const fmi2Integer)
NO_VARIABLES(fmi2SetBoolean, const fmi2Boolean)
NO_VARIABLES(fmi2SetString, const fmi2String)

/* -- saved states --------------------------------------------------------------------------- */

fmi2Status fmi2GetFMUstate(fmi2Component component, fmi2FMUstate* state) {
  INSTANCE(fmi2GetFMUstate, TF_ANY);
  return tf_fmi2(tf_save(c, state));
}

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state) {
  INSTANCE(fmi2SetFMUstate, TF_ANY);
  return tf_fmi2(tf_restore(c, state));
}

fmi2Status fmi2FreeFMUstate(fmi2Component component, fmi2FMUstate* state) {
  INSTANCE(fmi2FreeFMUstate, TF_ANY);
  if (state) {
    free(*state);
    *state = NULL;
  }
  return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component component, fmi2FMUstate state, size_t* size) {
  INSTANCE(fmi2SerializedFMUstateSize, TF_ANY);
  (void)state;
  *size = TF_SERIALIZED;
  return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component component, fmi2FMUstate state, fmi2Byte bytes[],
                                 size_t size) {
  INSTANCE(fmi2SerializeFMUstate, TF_ANY);
  return tf_fmi2(tf_pack(c, state, (unsigned char*)bytes, size));
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component component, const fmi2Byte bytes[], size_t size,
                                   fmi2FMUstate* state) {
  INSTANCE(fmi2DeSerializeFMUstate, TF_ANY);
  return tf_fmi2(tf_unpack(c, (const unsigned char*)bytes, size, state));
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component component,
                                        const fmi2ValueReference unknown[], size_t nu,
                                        const fmi2ValueReference known[], size_t nk,
                                        const fmi2Real seed[], fmi2Real result[]) {
  INSTANCE(fmi2GetDirectionalDerivative, TF_INITIALIZATION | TF_INITIALIZED | TF_TERMINATED);
  return tf_fmi2(tf_directional(c, unknown, nu, known, nk, seed, result));
}

/* -- model exchange ------------------------------------------------------------------------- */

fmi2Status fmi2EnterEventMode(fmi2Component component) {
  INSTANCE(fmi2EnterEventMode, TF_EVENT | TF_CONTINUOUS);
  if (c->s.phase == TF_CONTINUOUS) tf_enter_event(c);
  return fmi2OK;
}

fmi2Status fmi2NewDiscreteStates(fmi2Component component, fmi2EventInfo* info) {
  INSTANCE(fmi2NewDiscreteStates, TF_EVENT);
  tf_plan_event(c);
  memset(info, 0, sizeof *info);
  info->nextEventTimeDefined = isfinite(c->next_event);
  info->nextEventTime = isfinite(c->next_event) ? c->next_event : 0;
  return fmi2OK;
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component component) {
  INSTANCE(fmi2EnterContinuousTimeMode, TF_EVENT);
  return tf_fmi2(tf_enter_continuous(c));
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component component, fmi2Boolean no_set,
                                       fmi2Boolean* enter_event, fmi2Boolean* terminate) {
  INSTANCE(fmi2CompletedIntegratorStep, TF_CONTINUOUS);
  (void)no_set;
  *enter_event = *terminate = fmi2False;
  return fmi2OK;
}

fmi2Status fmi2SetTime(fmi2Component component, fmi2Real time) {
  INSTANCE(fmi2SetTime, TF_EVENT | TF_CONTINUOUS);
  return tf_fmi2(tf_set_time(c, time));
}

fmi2Status fmi2SetContinuousStates(fmi2Component component, const fmi2Real x[], size_t n) {
  INSTANCE(fmi2SetContinuousStates, TF_EVENT | TF_CONTINUOUS);
  return tf_fmi2(tf_set_states(c, x, n));
}

fmi2Status fmi2GetDerivatives(fmi2Component component, fmi2Real rates[], size_t n) {
  INSTANCE(fmi2GetDerivatives, TF_READABLE);
  return tf_fmi2(tf_rates(c, rates, n));
}

fmi2Status fmi2GetEventIndicators(fmi2Component component, fmi2Real indicators[], size_t n) {
  INSTANCE(fmi2GetEventIndicators, TF_READABLE);
  (void)indicators;
  return tf_fmi2(tf_indicators(c, n));
}

fmi2Status fmi2GetContinuousStates(fmi2Component component, fmi2Real x[], size_t n) {
  INSTANCE(fmi2GetContinuousStates, TF_READABLE);
  return tf_fmi2(tf_states(c, x, n));
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component component, fmi2Real nominal[],
                                             size_t n) {
  INSTANCE(fmi2GetNominalsOfContinuousStates, TF_ANY);
  return tf_fmi2(tf_nominals(c, nominal, n));
}

/* -- co-simulation -------------------------------------------------------------------------- */

fmi2Status fmi2SetRealInputDerivatives(fmi2Component component, const fmi2ValueReference r[],
                                       size_t n, const fmi2Integer order[],
                                       const fmi2Real value[]) {
  INSTANCE(fmi2SetRealInputDerivatives, TF_ANY);
  (void)r, (void)order, (void)value;
  return n ? tf_fmi2(tf_refuse(c, TF_ERROR, "inputs are not interpolated")) : fmi2OK;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component component, const fmi2ValueReference r[],
                                        size_t n, const fmi2Integer order[], fmi2Real value[]) {
  INSTANCE(fmi2GetRealOutputDerivatives, TF_ANY);
  (void)r, (void)order, (void)value;
  return n ? tf_fmi2(tf_refuse(c, TF_ERROR, "derivatives of outputs are not offered")) : fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component component, fmi2Real time, fmi2Real step,
                      fmi2Boolean no_restore) {
  INSTANCE(fmi2DoStep, TF_STEPPING);
  (void)no_restore;
  tf_status status = tf_step(c, time, step, 0);
  if (status == TF_DISCARD) c->s.phase = TF_FAILED;
  return tf_fmi2(status);
}

fmi2Status fmi2CancelStep(fmi2Component component) {
  INSTANCE(fmi2CancelStep, TF_ANY);
  return tf_fmi2(tf_refuse(c, TF_ERROR, "steps are never pending, so none can be cancelled"));
}

fmi2Status fmi2GetStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Status* value) {
  INSTANCE(fmi2GetStatus, TF_ANY);
  (void)kind, (void)value;
  return tf_fmi2(tf_refuse(c, TF_DISCARD, "steps are never pending"));
}

fmi2Status fmi2GetRealStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Real* value) {
  INSTANCE(fmi2GetRealStatus, TF_STEPPING | TF_FAILED | TF_TERMINATED);
  if (kind != fmi2LastSuccessfulTime)
    return tf_fmi2(tf_refuse(c, TF_DISCARD, "the last successful time is the only real status"));
  *value = c->s.last_good;
  return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component component, const fmi2StatusKind kind,
                                fmi2Integer* value) {
  INSTANCE(fmi2GetIntegerStatus, TF_ANY);
  (void)kind, (void)value;
  return tf_fmi2(tf_refuse(c, TF_DISCARD, "there is no integer status"));
}

fmi2Status fmi2GetBooleanStatus(fmi2Component component, const fmi2StatusKind kind,
                                fmi2Boolean* value) {
  INSTANCE(fmi2GetBooleanStatus, TF_ANY);
  if (kind != fmi2Terminated)
    return tf_fmi2(tf_refuse(c, TF_DISCARD, "whether it terminated is the only such status"));
  *value = fmi2False;
  return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component component, const fmi2StatusKind kind,
                               fmi2String* value) {
  INSTANCE(fmi2GetStringStatus, TF_ANY);
  (void)kind, (void)value;
  return tf_fmi2(tf_refuse(c, TF_DISCARD, "there is no string status"));
}
