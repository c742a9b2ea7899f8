/* Functions common to FMI 2.0 and 3.0, and macros for all functions. FMI(name) is a name with the
   prefix of the version; if the versions differ, names are those of FMI 3.0. */

#pragma GCC diagnostic ignored "-Wunused-parameter" /* some arguments of FMI are not needed */

#define TF_TEXT_OF(name) #name
#define TF_TEXT(name) TF_TEXT_OF(name)

/* An FMI function: its name, its arguments, the phases in which it may be called, and the expression
   of its status, with the instance c. */
#define FUNCTION(name, arguments, phases, does)                                                 \
  FMI(Status) FMI(name) arguments {                                                             \
    tf_instance* c = instance;                                                                  \
    if (!c || !tf_allowed(c, TF_TEXT(FMI(name)), phases)) return FMI(Error);                    \
    return (FMI(Status))(does);                                                                 \
  }

/* A function for a feature that these FMUs do not have. */
#define REFUSED(name, arguments, status, why)                                                   \
  FUNCTION(name, arguments, TF_ANY, tf_refuse(c, status, why))

/* A function for variables of another type: all variables are real, so every reference is unknown. */
#define NO_VARIABLES(name, ...)                                                                 \
  FUNCTION(name,                                                                                \
           (FMI(Instance) instance, const FMI(ValueReference) references[], size_t n,           \
            __VA_ARGS__),                                                                       \
           TF_ANY, n ? tf_unknown(c, TF_TEXT(FMI(name)), references[0]) : TF_OK)

static tf_instance* tf_instantiate(const char* name, const char* token, int model_exchange,
                                   int logging, void* environment, void* logger,
                                   const char* fault) {
  tf_instance shown = {.name = (char*)(name ? name : ""), .environment = environment,
                       .logger = logger};
  if (!token || strcmp(token, TF_TOKEN))
    fault = "cannot instantiate: the " FMI_TOKEN " is not that of this binary, so the model "
            "description is of another export";
  tf_instance* c = fault ? NULL : tf_create(shown.name, model_exchange, logging);
  if (!c) {
    tf_emit(&shown, TF_ERROR, fault ? fault : "cannot instantiate: out of memory");
    return NULL;
  }
  c->environment = environment;
  c->logger = logger;
  return c;
}

const char* FMI(GetVersion)(void) { return FMI(Version); }
void FMI(FreeInstance)(FMI(Instance) instance) { tf_free(instance); }

FUNCTION(SetDebugLogging,
         (FMI(Instance) instance, FMI(Boolean) on, size_t n, const FMI(String) categories[]),
         TF_ANY, (c->logging = on, TF_OK))
FUNCTION(ExitInitializationMode, (FMI(Instance) instance), TF_INITIALIZATION,
         tf_leave_initialization(c))
FUNCTION(Terminate, (FMI(Instance) instance), TF_INITIALIZED | TF_FAILED,
         tf_enter(c, TF_TERMINATED))
FUNCTION(Reset, (FMI(Instance) instance), TF_ANY, tf_reset(c))

/* -- saved states --------------------------------------------------------------------------- */

FUNCTION(GetFMUState, (FMI(Instance) instance, FMI(FMUState)* state), TF_ANY, tf_save(c, state))
FUNCTION(SetFMUState, (FMI(Instance) instance, FMI(FMUState) state), TF_ANY, tf_restore(c, state))
FUNCTION(FreeFMUState, (FMI(Instance) instance, FMI(FMUState)* state), TF_ANY, tf_forget(state))
FUNCTION(SerializedFMUStateSize, (FMI(Instance) instance, FMI(FMUState) state, size_t* size),
         TF_ANY, (*size = TF_SERIALIZED, TF_OK))
FUNCTION(SerializeFMUState,
         (FMI(Instance) instance, FMI(FMUState) state, FMI(Byte) bytes[], size_t size), TF_ANY,
         tf_pack(c, state, (unsigned char*)bytes, size))
FUNCTION(DeserializeFMUState,
         (FMI(Instance) instance, const FMI(Byte) bytes[], size_t size, FMI(FMUState)* state),
         TF_ANY, tf_unpack(c, (const unsigned char*)bytes, size, state))

/* -- model exchange ------------------------------------------------------------------------- */

FUNCTION(EnterEventMode, (FMI(Instance) instance), TF_EVENT | TF_CONTINUOUS, tf_enter_event(c))
FUNCTION(EnterContinuousTimeMode, (FMI(Instance) instance), TF_EVENT, tf_enter_continuous(c))
FUNCTION(CompletedIntegratorStep,
         (FMI(Instance) instance, FMI(Boolean) no_set, FMI(Boolean)* event, FMI(Boolean)* terminate),
         TF_CONTINUOUS,
         (*event = *terminate = FMI(False),
          tf_complete(c) == TF_FULL ? tf_event_fault(c, TF_FULL, c->s.time) : TF_OK))
FUNCTION(SetTime, (FMI(Instance) instance, FMI(Float64) time), TF_EVENT | TF_CONTINUOUS,
         tf_set_time(c, time))
FUNCTION(SetContinuousStates, (FMI(Instance) instance, const FMI(Float64) x[], size_t n),
         TF_EVENT | TF_CONTINUOUS, tf_set_states(c, x, n))
FUNCTION(GetContinuousStates, (FMI(Instance) instance, FMI(Float64) x[], size_t n), TF_READABLE,
         tf_states(c, x, n))
FUNCTION(GetContinuousStateDerivatives, (FMI(Instance) instance, FMI(Float64) rates[], size_t n),
         TF_READABLE, tf_rates(c, rates, n))
FUNCTION(GetEventIndicators, (FMI(Instance) instance, FMI(Float64) indicators[], size_t n),
         TF_READABLE, tf_indicators(c, indicators, n))
FUNCTION(GetNominalsOfContinuousStates, (FMI(Instance) instance, FMI(Float64) nominals[], size_t n),
         TF_ANY, tf_nominals(c, nominals, n))
