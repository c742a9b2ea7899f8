/* Instance of an FMU and the programs that it calls. The generated part of the source precedes this
   file: sizes (TF_U inputs, TF_P parameters, TF_X continuous states, TF_M discrete ones, TF_D
   discrete values and inputs, TF_Y outputs, of which TF_Y_LIGHT are cheap, TF_INDICATORS of state
   events), tables, and the list of programs TF_PROGRAMS; so do fixed_step.h and events.h. Value references
   count time, inputs, parameters, states, derivatives, outputs, modes and indicators, in that order, from 1:
   OMSimulator interprets the dependencies of FMI 3 as indices of variables. */

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define TF_ENUM(name) TF_##name,
enum { TF_PROGRAMS(TF_ENUM) TF_PROGRAM_COUNT };

/* First value reference of each group. */
enum {
  TF_VR_TIME = 1,
  TF_VR_U,
  TF_VR_P = TF_VR_U + TF_U,
  TF_VR_X = TF_VR_P + TF_P,
  TF_VR_DX = TF_VR_X + TF_X,
  TF_VR_Y = TF_VR_DX + TF_X,
  TF_VR_MODES = TF_VR_Y + TF_Y,
  TF_VR_G = TF_VR_MODES + TF_MODES,
  TF_VR_END = TF_VR_G + TF_INDICATORS
};

/* States of the FMI state machine, one bit each. */
enum {
  TF_INSTANTIATED = 1,
  TF_INITIALIZATION = 2,
  TF_EVENT = 4,      /* model exchange: event mode */
  TF_CONTINUOUS = 8, /* model exchange: continuous-time mode */
  TF_STEPPING = 16,  /* co-simulation: between steps */
  TF_FAILED = 32,    /* co-simulation, FMI 2: after a step that was not finished */
  TF_TERMINATED = 64
};
#define TF_INITIALIZED (TF_EVENT | TF_CONTINUOUS | TF_STEPPING)
#define TF_READABLE (TF_INITIALIZATION | TF_INITIALIZED | TF_FAILED | TF_TERMINATED)
#define TF_ANY 127

/* Status values, numbered as in both versions of FMI. */
typedef enum { TF_OK, TF_WARNING, TF_DISCARD, TF_ERROR } tf_status;

/* Complete saved state of an instance. */
typedef struct {
  int phase, model_exchange;
  int has_stop;
  int partial; /* the time is past the last grid point */
  int sampled; /* the ticks of the last grid point are final */
  int ended; /* a terminal event happened: the importer must end the run */
  long long tick; /* last grid point reached */
  double time, start, stop, last_good;
  double happened, handled; /* last times of an event, and of event handling in model exchange */
  double x[TF_X + 1], d[TF_D + 1], p[TF_P + 1];
#ifdef TF_VARIABLE
  tf_control control;
#endif
} tf_state;

typedef struct {
  tf_state s, before;
  const tf_program* programs;
  int logging, may_return_early;
  char* name;
  void *environment, *logger; /* the importer's, with the types of the FMI version */
  /* the members below can be recomputed and are not saved */
  int light_known, heavy_known, rates_known, instant_known, linear_known;
  double next_event;
  double dx[TF_X + 1], y[TF_Y + 1], d_instant[TF_D + 1], scratch[TF_X + TF_D + 1];
  tf_stepper stepper;
#ifdef TF_VARIABLE
  tf_variable variable;
#endif
  double* linear; /* work space of derivatives, allocated on first use */
} tf_instance;

static void tf_emit(tf_instance* c, tf_status status, const char* text);

/* Log why a call is refused, and return the status. Errors are always logged. Faults that a solver may
   cause, such as a value that is not finite, are logged only if logging is on. */
static tf_status tf_refuse(tf_instance* c, tf_status status, const char* format, ...) {
  char text[600];
  if (status != TF_ERROR && !c->logging) return status;
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  tf_emit(c, status, text);
  return status;
}

static const char* tf_phase_name(int phase) {
  switch (phase) {
    case TF_INSTANTIATED: return "before initialization";
    case TF_INITIALIZATION: return "in initialization mode";
    case TF_EVENT: return "in event mode";
    case TF_CONTINUOUS: return "in continuous-time mode";
    case TF_STEPPING: return "between steps";
    case TF_FAILED: return "after a step that failed: set a saved state, or reset";
    default: return "after termination";
  }
}

static int tf_allowed(tf_instance* c, const char* function, int phases) {
  if (c->s.phase & phases) return 1;
  tf_refuse(c, TF_ERROR, "%s cannot be called %s", function, tf_phase_name(c->s.phase));
  return 0;
}

/* Return the name of the variable of a value reference; *element counts from 1. */
static const char* tf_name_of(unsigned reference, unsigned* element) {
  int i = TF_VARIABLES - 1;
  while (i > 0 && tf_variables[i].first > reference) --i;
  *element = reference - tf_variables[i].first + 1;
  return tf_variables[i].name;
}
