/* A host without Python: loads the binary of an FMI 2.0 FMU, runs it in co-simulation, and prints
   one output at the end. Arguments: library, GUID, value reference of the output, number of
   steps, step size, then pairs of value reference and value to set during initialization. */

#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include "fmi2Functions.h"

static void logger(fmi2ComponentEnvironment e, fmi2String name, fmi2Status s, fmi2String category,
                   fmi2String text, ...) {
  (void)e;
  fprintf(stderr, "%s: status %d, %s: %s\n", name, s, category, text);
}

#define LOAD(name)                                                \
  name##TYPE* name##_ = (name##TYPE*)dlsym(library, #name);       \
  if (!name##_) {                                                 \
    fprintf(stderr, "no function %s\n", #name);                   \
    return 2;                                                     \
  }
#define CHECK(call)                                               \
  if ((call) != fmi2OK) {                                         \
    fprintf(stderr, "failed: %s\n", #call);                       \
    return 3;                                                     \
  }

int main(int n, char** v) {
  void* library = dlopen(v[1], RTLD_NOW | RTLD_LOCAL);
  if (!library) {
    fprintf(stderr, "%s\n", dlerror());
    return 1;
  }
  LOAD(fmi2Instantiate)
  LOAD(fmi2SetupExperiment)
  LOAD(fmi2EnterInitializationMode)
  LOAD(fmi2ExitInitializationMode)
  LOAD(fmi2SetReal)
  LOAD(fmi2GetReal)
  LOAD(fmi2DoStep)
  LOAD(fmi2Terminate)
  LOAD(fmi2FreeInstance)
  fmi2CallbackFunctions callbacks = {logger, calloc, free, NULL, NULL};
  fmi2Component c = fmi2Instantiate_("host", fmi2CoSimulation, v[2], "", &callbacks, 0, 1);
  if (!c) return 4;
  fmi2ValueReference output = (fmi2ValueReference)strtoul(v[3], NULL, 10);
  int steps = atoi(v[4]);
  double h = atof(v[5]), value;
  CHECK(fmi2SetupExperiment_(c, 0, 0, 0, 0, 0))
  CHECK(fmi2EnterInitializationMode_(c))
  for (int i = 6; i + 1 < n; i += 2) {
    fmi2ValueReference reference = (fmi2ValueReference)strtoul(v[i], NULL, 10);
    value = atof(v[i + 1]);
    CHECK(fmi2SetReal_(c, &reference, 1, &value))
  }
  CHECK(fmi2ExitInitializationMode_(c))
  for (int k = 0; k < steps; ++k) CHECK(fmi2DoStep_(c, k * h, h, 1))
  CHECK(fmi2GetReal_(c, &output, 1, &value))
  CHECK(fmi2Terminate_(c))
  fmi2FreeInstance_(c);
  printf("%.17g\n", value);
  return 0;
}
