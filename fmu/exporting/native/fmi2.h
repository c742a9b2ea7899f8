/* Definitions of FMI 2.0 for functions.c. */

#undef FMI2_FUNCTION_PREFIX /* functions of a shared library have no prefix of the model */
#include "fmi2Functions.h"

#define FMI(name) fmi2##name
#define FMI_TOKEN "GUID"

/* Names of FMI 3.0 for functions of FMI 2.0. */
#define fmi2Instance fmi2Component
#define fmi2Float64 fmi2Real
#define fmi2FMUState fmi2FMUstate
#define fmi2GetFMUState fmi2GetFMUstate
#define fmi2SetFMUState fmi2SetFMUstate
#define fmi2FreeFMUState fmi2FreeFMUstate
#define fmi2SerializedFMUStateSize fmi2SerializedFMUstateSize
#define fmi2SerializeFMUState fmi2SerializeFMUstate
#define fmi2DeserializeFMUState fmi2DeSerializeFMUstate
#define fmi2GetContinuousStateDerivatives fmi2GetDerivatives

static void tf_emit(tf_instance* c, tf_status status, const char* text) {
  fmi2CallbackLogger logger = (fmi2CallbackLogger)c->logger;
  if (logger) logger(c->environment, c->name, (fmi2Status)status, "logStatus", text);
}
