/* Definitions of FMI 3.0 for functions.c. */

#include "fmi3Functions.h"

#define FMI(name) fmi3##name
#define FMI_TOKEN "instantiation token"

static void tf_emit(tf_instance* c, tf_status status, const char* text) {
  fmi3LogMessageCallback logger = (fmi3LogMessageCallback)c->logger;
  if (logger) logger(c->environment, (fmi3Status)status, "logStatus", text);
}
