/* Small FMUs for the tests, written by hand against the standard's headers: models with exact
 * solutions and events, and faults on demand. The token says which model an instance is. Compiled
 * once for FMI 2 and once, with -DFMI3, for FMI 3. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#ifdef FMI3
#include "fmi3Functions.h"
#define EXPORT FMI3_Export
#define NAME(name) fmi3##name
typedef fmi3Status Status;
typedef fmi3Boolean Flag;
typedef fmi3Instance Handle;
#define OK fmi3OK
#define DISCARD fmi3Discard
#define ERROR fmi3Error
#else
#include "fmi2Functions.h"
#define EXPORT FMI2_Export
#define NAME(name) fmi2##name
typedef fmi2Status Status;
typedef fmi2Boolean Flag;
typedef fmi2Component Handle;
#define OK fmi2OK
#define DISCARD fmi2Discard
#define ERROR fmi2Error
#endif

enum { BALL, STAIR, RELAY, TYPES };
/* Value references, for each type of variable. */
enum { H, V, DH, DV, G, E, U, D, Y, PERIOD, HMAX, REALS };
enum { COUNT, FAULT, I_IN, I_OUT, RELAY_ON, INTEGERS };
enum { B_IN, B_OUT, BOOLEANS };
enum { NONE, INIT, STEP, HANG, CRASH, DISCARD_ALL, DISCARD_LONG, END, ENDLESS, REFUSE_INPUT, STUCK,
       END_AT_EVENT, DISCARD_ONCE, END_AFTER, REQUEST, FATAL, UNREADABLE };
#define ARRAY 8

typedef struct {
    int model, early, events, ended, failed, refused, steps, requested;
    int modes, running, in_event; /* whether there are modes; initialized; in event mode */
    double begin, t, next, r[REALS], last;
    int i[INTEGERS], b[BOOLEANS];
    size_t n;
    double in[ARRAY], out[ARRAY], gains[ARRAY];
    char text[64];
#ifdef FMI3
    fmi3LogMessageCallback log;
    fmi3InstanceEnvironment environment;
#else
    fmi2CallbackFunctions callbacks;
#endif
} Model;

static void say(Model *m, Status status, const char *what, int number) {
    m->failed = m->failed || status == ERROR;
#ifdef FMI3
    char line[200];
    snprintf(line, sizeof line, "the model says: %s (number %d)", what, number);
    m->log(m->environment, status, "test", line);
#else
    m->callbacks.logger(m->callbacks.componentEnvironment, "model", status, "test",
                        "the model says: %s (number %d)", what, number);
#endif
}

static int model_of(const char *token) {
    const char *names[] = {"ball", "stair", "relay", "types"};
    for (int i = 0; i < 4; i++)
        if (!strcmp(token, names[i])) return i;
    return -1;
}

static void defaults(Model *m) {
    m->r[H] = m->model == BALL ? 1.0 : 0.0;
    m->r[G] = 9.81, m->r[E] = 0.7, m->r[PERIOD] = 0.35, m->r[HMAX] = 1e9;
    m->n = 3;
    for (int k = 0; k < ARRAY; k++) m->gains[k] = 2;
    strcpy(m->text, "nothing");
}

static void settle(Model *m) { /* after initialization */
    m->begin = m->t;
    m->next = m->model == STAIR ? m->t + m->r[PERIOD] : INFINITY;
    m->i[RELAY_ON] = m->r[U] > 0.5;
    m->last = m->t;
}

static void compute(Model *m) {
    m->r[DH] = m->model == RELAY ? -m->r[H] + m->i[RELAY_ON] + m->r[D] : m->r[V];
    m->r[DV] = -m->r[G];
    m->r[Y] = m->model == STAIR ? m->i[COUNT] : m->model == TYPES ? 2 * m->r[U] : m->r[H];
    m->i[I_OUT] = m->i[I_IN] + 1;
    m->b[B_OUT] = !m->b[B_IN];
    for (size_t k = 0; k < m->n; k++) m->out[k] = m->gains[k] * m->in[k];
}

static int event(Model *m) { /* returns whether continuous states jumped */
    int jumped = 0;
    if (m->model == BALL && m->r[H] <= 0 && m->r[V] < 0) {
        m->r[H] = 0, m->r[V] *= -m->r[E], m->i[COUNT]++, jumped = 1;
    }
    if (m->requested) m->r[H] += 0.125, m->requested = 0, jumped = 1;
    while (m->model == STAIR && m->t >= m->next) {
        m->i[COUNT]++;
        m->next = m->begin + (m->i[COUNT] + 1) * m->r[PERIOD];
    }
    if (m->model == RELAY) m->i[RELAY_ON] = m->r[U] > 0.5;
    return jumped;
}

static int advance(Model *m, double end) { /* returns 1 at an event, where it stops if asked to */
    while (m->t < end) {
        double span = end - m->t, until = INFINITY;
        if (m->model == BALL) until = (m->r[V] + sqrt(m->r[V] * m->r[V] + 2 * m->r[G] * m->r[H])) / m->r[G];
        if (m->model == STAIR) until = m->next - m->t;
        int hit = until <= span;
        double s = hit ? until : span;
        if (m->model == BALL) {
            m->r[H] = hit ? 0 : m->r[H] + m->r[V] * s - m->r[G] * s * s / 2;
            m->r[V] -= m->r[G] * s;
        }
        if (m->model == RELAY) {
            double c = m->i[RELAY_ON] + m->r[D];
            m->r[H] = c + (m->r[H] - c) * exp(-s);
        }
        m->t = hit ? (m->model == STAIR ? m->next : m->t + s) : end;
        if (hit && m->events) return 1;
        if (hit) event(m);
        if (hit && m->early) return 1;
    }
    return 0;
}

static Status step(Model *m, double t, double h, int *hit) {
    *hit = 0;
    if (fabs(t - m->t) > 1e-9) {
        say(m, ERROR, "step from another time than mine", 0);
        return ERROR;
    }
    switch (m->i[FAULT]) {
    case STEP: say(m, ERROR, "the spring broke", 42); return ERROR;
    case HANG: for (volatile int i = 1; i;) {} break;
    case CRASH: say(m, OK, "about to crash", 7); abort();
    case DISCARD_ALL: say(m, DISCARD, "too stiff", 3); m->last = t; return DISCARD;
    case DISCARD_ONCE: /* FMI 2 allows no step then, but from a saved state */
        if (m->refused) { say(m, ERROR, "no step after a refused one", 9); return ERROR; }
        m->refused = 1, m->last = t;
        return DISCARD;
    case DISCARD_LONG:
        if (h > m->r[HMAX] * (1 + 1e-9)) {
            m->last = t; /* nothing done: ask for less */
            return DISCARD;
        }
        break;
    case END: if (t + h > 0.5) { m->ended = 1; say(m, OK, "the tank is empty", 5); return DISCARD; }
    }
    if (m->model == RELAY && !m->events) event(m);
    *hit = advance(m, t + h);
    m->last = m->t;
    if (m->i[FAULT] == END_AFTER && m->t > 0.55) { /* FMI 2 can say so of a discarded step only */
        m->ended = 1;
#ifdef FMI2
        return DISCARD;
#endif
    }
    return OK;
}

static int too_late(Model *m) { /* to set what may change at events only */
    if (!m->modes || !m->running || m->in_event) return 0;
    say(m, ERROR, "this may be set in event mode only", 8);
    return 1;
}

#ifdef HOSTILE
#include "misdeeds.h"
#else
#define MISDEED
#endif
#define SELF MISDEED Model *m = (Model *)c
#define ACCESS(NAME, TYPE, FIELD, WHEN)                                                                  \
    EXPORT Status NAME(Get##TYPE)(Handle c, const unsigned vr[], size_t n, VALUE(TYPE) v[] COUNT_ARG) {       \
        SELF; compute(m);                                                                          \
        for (size_t k = 0; k < n; k++) v[k] = m->FIELD[vr[k] % 100];                                     \
        return fails(m, UNREADABLE, m->r[U] > 0.5, ERROR);                                         \
    }                                                                                              \
    EXPORT Status NAME(Set##TYPE)(Handle c, const unsigned vr[], size_t n, const VALUE(TYPE) v[] COUNT_ARG) { \
        SELF;                                                                                      \
        if (WHEN) return ERROR;                                                                    \
        for (size_t k = 0; k < n; k++) m->FIELD[vr[k] % 100] = v[k];                                     \
        return OK;                                                                                 \
    }

#define EMPTY(NAME_) EXPORT Status NAME(NAME_)(Handle c) { MISDEED (void)c; return OK; }

static Model *make(const char *token) {
    int model = model_of(token);
    if (model < 0) return NULL;
    Model *m = calloc(1, sizeof *m);
    m->model = model;
    defaults(m);
    return m;
}

EXPORT Status NAME(ExitInitializationMode)(Handle c) {
    SELF;
    if (m->i[FAULT] == INIT) { say(m, ERROR, m->text, 1); return ERROR; }
    settle(m);
    m->running = 1, m->in_event = m->modes;
    return OK;
}
EXPORT Status NAME(Terminate)(Handle c) {
    SELF;
    if (m->failed) say(m, ERROR, "terminated after an error", 6);
    return OK;
}
EXPORT Status NAME(EnterEventMode)(Handle c) { SELF; m->in_event = 1; return OK; }
EXPORT Status NAME(EnterContinuousTimeMode)(Handle c) { SELF; m->in_event = 0; return OK; }
EXPORT Status NAME(SetTime)(Handle c, double t) {
    SELF;
    if (m->failed) abort(); /* FMI forbids this call after an error */
    m->t = t;
    return OK;
}
static Status fails(Model *m, int fault, int when, Status status) {
    return m->i[FAULT] == fault && when ? (m->failed = 1, status) : OK;
}
EXPORT Status NAME(SetContinuousStates)(Handle c, const double x[], size_t n) {
    SELF; memcpy(m->r, x, n * sizeof *x); return OK;
}
EXPORT Status NAME(GetContinuousStates)(Handle c, double x[], size_t n) {
    SELF; memcpy(x, m->r, n * sizeof *x); return OK;
}
EXPORT Status NAME(GetEventIndicators)(Handle c, double z[], size_t n) {
    SELF;
    if (n) z[0] = m->model == BALL ? m->r[H] : m->r[U] - 0.5;
    return OK;
}

#ifdef FMI3
#define VALUE(TYPE) fmi3##TYPE
#define COUNT_ARG , size_t nv
ACCESS(NAME, Int32, i, too_late(m))
ACCESS(NAME, Boolean, b, too_late(m))
EXPORT Status fmi3GetFloat64(Handle c, const unsigned vr[], size_t n, double v[], size_t nv) {
    SELF; compute(m); (void)nv;
    for (size_t k = 0; k < n; k++) {
        if (vr[k] >= 100) { memcpy(v, vr[k] == 100 ? m->in : m->out, m->n * sizeof *v); v += m->n; }
        else *v++ = m->r[vr[k]];
    }
    return fails(m, UNREADABLE, m->r[U] > 0.5, ERROR);
}
EXPORT Status fmi3SetFloat64(Handle c, const unsigned vr[], size_t n, const double v[], size_t nv) {
    SELF; (void)nv;
    for (size_t k = 0; k < n; k++) {
        if (vr[k] == U && m->i[FAULT] == REFUSE_INPUT) { say(m, ERROR, "no such input", 9); return ERROR; }
        if (vr[k] == D && too_late(m)) return ERROR;
        if (vr[k] >= 100) { memcpy(vr[k] == 100 ? m->in : m->gains, v, m->n * sizeof *v); v += m->n; }
        else m->r[vr[k]] = *v++;
    }
    return OK;
}
EXPORT Status fmi3SetUInt64(Handle c, const unsigned vr[], size_t n, const fmi3UInt64 v[], size_t nv) {
    SELF; (void)vr; (void)n; (void)nv; m->n = (size_t)v[0]; return OK;
}
EXPORT Status fmi3SetString(Handle c, const unsigned vr[], size_t n, const fmi3String v[], size_t nv) {
    SELF; (void)vr; (void)n; (void)nv; snprintf(m->text, sizeof m->text, "%s", v[0]); return OK;
}
EMPTY(EnterConfigurationMode)
EMPTY(ExitConfigurationMode)
EXPORT Status fmi3EnterStepMode(Handle c) { SELF; m->in_event = 0; return OK; }
static Handle opened(fmi3String token, fmi3InstanceEnvironment e, fmi3LogMessageCallback log, int modes, int events, int early) {
    Model *m = make(token);
    if (!m) { log(e, fmi3Error, "test", "this is not my token"); return NULL; }
    m->log = log, m->environment = e, m->events = events, m->early = early, m->modes = modes;
    return m;
}
EXPORT Handle fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, Flag visible,
                                           Flag logging, fmi3InstanceEnvironment e, fmi3LogMessageCallback log) {
    MISDEED (void)name; (void)resources; (void)visible; (void)logging;
    return opened(token, e, log, 1, 0, 0);
}
EXPORT Handle fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, Flag visible,
                                          Flag logging, Flag events, Flag early, const unsigned vr[], size_t n,
                                          fmi3InstanceEnvironment e, fmi3LogMessageCallback log,
                                          fmi3IntermediateUpdateCallback update) {
    MISDEED (void)name; (void)resources; (void)visible; (void)logging; (void)vr; (void)n; (void)update;
    return opened(token, e, log, events, events, early);
}
EXPORT void fmi3FreeInstance(Handle c) { MISDEED free(c); }
EXPORT Status fmi3EnterInitializationMode(Handle c, Flag td, double tol, double start, Flag sd, double stop) {
    SELF; (void)td; (void)tol; (void)sd; (void)stop; m->t = start; return OK;
}
EXPORT Status fmi3GetContinuousStateDerivatives(Handle c, double dx[], size_t n) {
    SELF; compute(m); memcpy(dx, m->r + DH, n * sizeof *dx); return fails(m, FATAL, m->t > 0.5, NAME(Fatal));
}
EXPORT Status fmi3CompletedIntegratorStep(Handle c, Flag prior, Flag *wanted, Flag *end) {
    SELF; (void)prior; *wanted = m->requested = m->i[FAULT] == REQUEST && ++m->steps % 7 == 0; *end = (m->i[FAULT] == END || m->i[FAULT] == END_AFTER) && m->t > 0.5; return OK;
}
EXPORT Status fmi3UpdateDiscreteStates(Handle c, Flag *again, Flag *end, Flag *nominals, Flag *changed, Flag *defined, double *next) {
    SELF;
    *changed = event(m), *again = m->i[FAULT] == ENDLESS, *nominals = 0;
    *end = m->i[FAULT] == END_AT_EVENT && (m->model != STAIR || m->i[COUNT] > 1);
    *defined = isfinite(m->next), *next = m->next;
    return OK;
}
EXPORT Status fmi3DoStep(Handle c, double t, double h, Flag prior, Flag *event_, Flag *end, Flag *early, double *reached) {
    SELF; (void)prior;
    int hit;
    Status status = step(m, t, h, &hit);
    if (m->i[FAULT] == STUCK) hit = 1, m->t = t;
    *event_ = hit && m->events, *early = hit && m->t < t + h, *reached = m->t, *end = m->ended;
    return status;
}
EXPORT Status fmi3GetFMUState(Handle c, fmi3FMUState *s) { MISDEED *s = memcpy(malloc(sizeof(Model)), c, sizeof(Model)); return OK; }
EXPORT Status fmi3SetFMUState(Handle c, fmi3FMUState s) { MISDEED memcpy(c, s, sizeof(Model)); return OK; }
EXPORT Status fmi3FreeFMUState(Handle c, fmi3FMUState *s) { MISDEED (void)c; free(*s); *s = NULL; return OK; }
EXPORT Status fmi3SerializedFMUStateSize(Handle c, fmi3FMUState s, size_t *n) { MISDEED (void)c; (void)s; *n = sizeof(Model); return OK; }
EXPORT Status fmi3SerializeFMUState(Handle c, fmi3FMUState s, fmi3Byte b[], size_t n) { MISDEED (void)c; memcpy(b, s, n); return OK; }
EXPORT Status fmi3DeserializeFMUState(Handle c, const fmi3Byte b[], size_t n, fmi3FMUState *s) {
    SELF; Model *copy = memcpy(malloc(n), b, n);
    copy->log = m->log, copy->environment = m->environment;
    *s = copy;
    return OK;
}
#else
#define VALUE(TYPE) fmi2##TYPE
#define COUNT_ARG
ACCESS(NAME, Real, r, n && vr[0] == D && too_late(m))
ACCESS(NAME, Integer, i, too_late(m))
ACCESS(NAME, Boolean, b, too_late(m))
EXPORT Status fmi2SetString(Handle c, const unsigned vr[], size_t n, const fmi2String v[]) {
    SELF; (void)vr; (void)n; snprintf(m->text, sizeof m->text, "%s", v[0]); return OK;
}
EXPORT Handle fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, Flag visible, Flag logging) {
    MISDEED (void)name; (void)resources; (void)visible; (void)logging;
    Model *m = make(token);
    if (!m) callbacks->logger(callbacks->componentEnvironment, name, fmi2Error, "test", "%s", "this is not my token");
    else m->callbacks = *callbacks, m->modes = type == fmi2ModelExchange;
    return m;
}
EXPORT void fmi2FreeInstance(Handle c) { MISDEED free(c); }
EXPORT Status fmi2SetupExperiment(Handle c, Flag td, double tol, double start, Flag sd, double stop) {
    SELF; (void)td; (void)tol; (void)sd; (void)stop; m->t = start; return OK;
}
EMPTY(EnterInitializationMode)
EXPORT Status fmi2GetDerivatives(Handle c, double dx[], size_t n) {
    SELF; compute(m); memcpy(dx, m->r + DH, n * sizeof *dx); return fails(m, FATAL, m->t > 0.5, NAME(Fatal));
}
EXPORT Status fmi2CompletedIntegratorStep(Handle c, Flag prior, Flag *wanted, Flag *end) {
    SELF; (void)prior; *wanted = m->requested = m->i[FAULT] == REQUEST && ++m->steps % 7 == 0; *end = (m->i[FAULT] == END || m->i[FAULT] == END_AFTER) && m->t > 0.5; return OK;
}
EXPORT Status fmi2NewDiscreteStates(Handle c, fmi2EventInfo *info) {
    SELF;
    info->valuesOfContinuousStatesChanged = event(m);
    info->newDiscreteStatesNeeded = m->i[FAULT] == ENDLESS;
    info->terminateSimulation = m->i[FAULT] == END_AT_EVENT && (m->model != STAIR || m->i[COUNT] > 1);
    info->nominalsOfContinuousStatesChanged = 0;
    info->nextEventTimeDefined = isfinite(m->next), info->nextEventTime = m->next;
    return OK;
}
EXPORT Status fmi2DoStep(Handle c, double t, double h, Flag prior) {
    SELF; (void)prior; int hit; return step(m, t, h, &hit);
}
EXPORT Status fmi2GetRealStatus(Handle c, const fmi2StatusKind kind, double *v) { SELF; (void)kind; *v = m->last; return OK; }
EXPORT Status fmi2GetBooleanStatus(Handle c, const fmi2StatusKind kind, Flag *v) { SELF; (void)kind; *v = m->ended; return OK; }
EXPORT Status fmi2GetFMUstate(Handle c, fmi2FMUstate *s) { MISDEED *s = memcpy(malloc(sizeof(Model)), c, sizeof(Model)); return OK; }
EXPORT Status fmi2SetFMUstate(Handle c, fmi2FMUstate s) { MISDEED memcpy(c, s, sizeof(Model)); return OK; }
EXPORT Status fmi2FreeFMUstate(Handle c, fmi2FMUstate *s) { MISDEED (void)c; free(*s); *s = NULL; return OK; }
EXPORT Status fmi2SerializedFMUstateSize(Handle c, fmi2FMUstate s, size_t *n) { MISDEED (void)c; (void)s; *n = sizeof(Model); return OK; }
EXPORT Status fmi2SerializeFMUstate(Handle c, fmi2FMUstate s, fmi2Byte b[], size_t n) { MISDEED (void)c; memcpy(b, s, n); return OK; }
EXPORT Status fmi2DeSerializeFMUstate(Handle c, const fmi2Byte b[], size_t n, fmi2FMUstate *s) {
    SELF; Model *copy = memcpy(malloc(n), b, n);
    copy->callbacks = m->callbacks;
    *s = copy;
    return OK;
}
#endif
