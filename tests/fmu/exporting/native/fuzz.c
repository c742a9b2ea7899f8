/* Calls the functions of an FMU of ours in random order, legal or not, with good and bad arguments.
   Compiled together with its sources (-DFMI3 for version 3) and the sanitizers, which end the program
   when something is wrong. Arguments: token, sequences, first seed; prints the number of calls. */

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef FMI3
#include "fmi3Functions.h"
typedef fmi3Instance instance;
typedef fmi3FMUState state;
#else
#include "fmi2Functions.h"
typedef fmi2Component instance;
typedef fmi2FMUstate state;
#endif

static uint64_t seed;
static uint64_t next(void) { /* xorshift64* (Vigna 2016) */
  seed ^= seed >> 12, seed ^= seed << 25, seed ^= seed >> 27;
  return seed * 0x2545F4914F6CDD1Dull;
}
static unsigned below(unsigned n) { return (unsigned)(next() >> 33) % n; }
static double number(void) {
  static const double odd[] = {0.0, -0.0, 1.0, -1.0, 1e300, -1e300, 1e-300, 0.5, 100.0};
  switch (below(12)) {
    case 0: return NAN;
    case 1: return INFINITY;
    case 2: return odd[below(9)];
    default: return (double)below(1000) / 100 - 5;
  }
}

enum { MOST = 64, STATES = 4 };
static unsigned references[MOST];
static double values[MOST], others[4096];
static unsigned draw(void) {
  unsigned n = below(8) ? below(6) : below(MOST);
  for (unsigned i = 0; i < n; ++i) {
    references[i] = below(20) ? below(40) : (unsigned)next();
    values[i] = number();
  }
  return n;
}

#ifdef FMI3
static void logger(fmi3InstanceEnvironment e, fmi3Status s, fmi3String c, fmi3String text) {
  (void)e, (void)s, (void)c;
  if (!text || strlen(text) > 10000) abort();
}
static instance create(const char* token) {
  if (below(2))
    return fmi3InstantiateModelExchange("one", token, "", 0, below(2), NULL, below(4) ? logger : NULL);
  return fmi3InstantiateCoSimulation("one", token, "", 0, below(2), below(2), 0, NULL, 0, NULL,
                                     below(4) ? logger : NULL, NULL);
}
#else
static void logger(fmi2ComponentEnvironment e, fmi2String n, fmi2Status s, fmi2String c, fmi2String text, ...) {
  (void)e, (void)n, (void)s, (void)c;
  if (!text || strlen(text) > 10000) abort();
}
static const fmi2CallbackFunctions callbacks = {logger, calloc, free, NULL, NULL};
static instance create(const char* token) {
  fmi2Type kind = below(2) ? fmi2ModelExchange : fmi2CoSimulation;
  return fmi2Instantiate("one", kind, token, "", below(4) ? &callbacks : NULL, 0, below(2));
}
#endif

static instance one;
static state saved[STATES];
static unsigned char* bytes;
static size_t size;

static void some_call(const char* token) {
  double time = below(3) ? below(100) / 100.0 : number(), h = below(3) ? below(50) / 500.0 : number();
  unsigned n = draw(), known, k = below(STATES), many = below(2) ? below(20) : 0;
  instance c = below(200) ? one : NULL;
  if (h > 10.0) h = number() * 1e-3; /* long steps only take long */
#ifdef FMI3
  fmi3Boolean flags[4];
  fmi3Float64 when;
  size_t many_values = below(4) ? n : below(MOST);
  switch (below(24)) {
    case 0: fmi3EnterInitializationMode(c, below(2), 1e-6, time, below(2), time + 1.0); break;
    case 1: fmi3ExitInitializationMode(c); break;
    case 2: case 3: fmi3SetFloat64(c, references, n, values, many_values); break;
    case 4: case 5: fmi3GetFloat64(c, references, n, values, many_values); break;
    case 6: case 7: case 8: fmi3DoStep(c, time, h, below(2), &flags[0], &flags[1], &flags[2], &when); break;
    case 9: fmi3Reset(c); break;
    case 10: fmi3Terminate(c); break;
    case 11: fmi3EnterEventMode(c); break;
    case 12: fmi3EnterContinuousTimeMode(c); break;
    case 13:
      fmi3UpdateDiscreteStates(c, &flags[0], &flags[1], &flags[2], &flags[3], &flags[0], &when);
      break;
    case 14: fmi3SetTime(c, time); break;
    case 15: fmi3SetContinuousStates(c, values, many); break;
    case 16: fmi3GetContinuousStates(c, others, many); break;
    case 17: fmi3GetContinuousStateDerivatives(c, others, many); break;
    case 18: fmi3GetFMUState(c, &saved[k]); break;
    case 19: fmi3SetFMUState(c, saved[k]); break;
    case 20: fmi3FreeFMUState(c, &saved[k]); break;
    case 21:
      if (fmi3SerializedFMUStateSize(c, saved[k], &size) == fmi3OK && size < 1 << 20) {
        free(bytes);
        bytes = calloc(1, size);
        if (fmi3SerializeFMUState(c, saved[k], bytes, size) == fmi3OK && below(3) == 0)
          bytes[below((unsigned)size)] ^= (unsigned char)(1u << below(8));
      }
      break;
    case 22: if (bytes) fmi3DeserializeFMUState(c, bytes, below(4) ? size : below((unsigned)size + 1), &saved[k]); break;
    default:
      known = below(4);
      if (below(2))
        fmi3GetDirectionalDerivative(c, references, n, references, known, values, known, others, n);
      else
        fmi3GetAdjointDerivative(c, references, n, references, known, values, n, others, known);
  }
#else
  fmi2EventInfo info;
  fmi2Boolean flags[2];
  switch (below(24)) {
    case 0: fmi2SetupExperiment(c, below(2), 1e-6, time, below(2), time + 1.0); break;
    case 1: fmi2EnterInitializationMode(c); fmi2ExitInitializationMode(c); break;
    case 2: case 3: fmi2SetReal(c, references, n, values); break;
    case 4: case 5: fmi2GetReal(c, references, n, values); break;
    case 6: case 7: case 8: fmi2DoStep(c, time, h, below(2)); break;
    case 9: fmi2Reset(c); break;
    case 10: fmi2Terminate(c); break;
    case 11: fmi2EnterEventMode(c); break;
    case 12: fmi2EnterContinuousTimeMode(c); break;
    case 13: fmi2NewDiscreteStates(c, &info); break;
    case 14: fmi2SetTime(c, time); break;
    case 15: fmi2SetContinuousStates(c, values, many); break;
    case 16: fmi2GetContinuousStates(c, others, many); break;
    case 17: fmi2GetDerivatives(c, others, many); break;
    case 18: fmi2GetFMUstate(c, &saved[k]); break;
    case 19: fmi2SetFMUstate(c, saved[k]); break;
    case 20: fmi2FreeFMUstate(c, &saved[k]); break;
    case 21:
      if (fmi2SerializedFMUstateSize(c, saved[k], &size) == fmi2OK && size < 1 << 20) {
        free(bytes);
        bytes = calloc(1, size);
        if (fmi2SerializeFMUstate(c, saved[k], (fmi2Byte*)bytes, size) == fmi2OK && below(3) == 0)
          bytes[below((unsigned)size)] ^= (unsigned char)(1u << below(8));
      }
      break;
    case 22: if (bytes) fmi2DeSerializeFMUstate(c, (fmi2Byte*)bytes, below(4) ? size : below((unsigned)size + 1), &saved[k]); break;
    default:
      known = below(4);
      fmi2GetDirectionalDerivative(c, references, n, references, known, values, others);
      fmi2CompletedIntegratorStep(c, 1, &flags[0], &flags[1]);
  }
#endif
  (void)token;
}

int main(int argc, char** argv) {
  long calls = 0, sequences = argc > 3 ? atol(argv[2]) : 1;
  for (long i = 0; i < sequences; ++i) {
    seed = ((uint64_t)atol(argv[3]) + (uint64_t)i) * 0x9E3779B97F4A7C15ull + 1;
    one = create(below(50) ? argv[1] : "wrong");
    for (unsigned n = below(60); n--; ++calls) some_call(argv[1]);
#ifdef FMI3
    for (int k = 0; k < STATES; ++k) fmi3FreeFMUState(one, &saved[k]);
    for (int k = 0; k < STATES; ++k) free(saved[k]), saved[k] = NULL;
    fmi3FreeInstance(one);
#else
    for (int k = 0; k < STATES; ++k) fmi2FreeFMUstate(one, &saved[k]);
    for (int k = 0; k < STATES; ++k) free(saved[k]), saved[k] = NULL;
    fmi2FreeInstance(one);
#endif
  }
  free(bytes);
  printf("%ld\n", calls);
  return 0;
}
