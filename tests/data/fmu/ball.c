/* A ball that bounces and is pushed, for model exchange of FMI 2.0 and 3.0: see built.py beside the tests. */

#include <stdlib.h>
#include <string.h>

#ifdef FMI3
#include "fmi3Functions.h"
#define P(name) fmi3##name
typedef fmi3Instance instance_t;
typedef fmi3Float64 real_t;
typedef fmi3ValueReference reference_t;
#define COUNTED , size_t values
#else
#include "fmi2Functions.h"
#define P(name) fmi2##name
typedef fmi2Component instance_t;
typedef fmi2Real real_t;
typedef fmi2ValueReference reference_t;
#define COUNTED
#endif

enum { HEIGHT, SPEED, PUSH, BOUNCE, COUNT };

typedef struct {
  real_t value[COUNT]; /* m, m/s, m/s^2, share of the speed */
  int rests;           /* on the ground: it would bounce infinitely often */
} ball_t;

static void start(ball_t* ball) {
  ball->value[HEIGHT] = 1.0;
  ball->value[SPEED] = ball->value[PUSH] = 0.0;
  ball->value[BOUNCE] = 0.7;
  ball->rests = 0;
}

static instance_t made(void) {
  ball_t* ball = calloc(1, sizeof(ball_t));
  start(ball);
  return ball;
}

#ifdef FMI3
fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String path, fmi3Boolean visible,
                                          fmi3Boolean log, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback message) {
  return made();
}
void fmi3FreeInstance(fmi3Instance instance) { free(instance); }
#else
fmi2Component fmi2Instantiate(fmi2String name, fmi2Type kind, fmi2String token, fmi2String path,
                              const fmi2CallbackFunctions* functions, fmi2Boolean visible, fmi2Boolean log) {
  return made();
}
void fmi2FreeInstance(fmi2Component instance) { free(instance); }
#endif

P(Status) P(Reset)(instance_t instance) {
  start(instance);
  return P(OK);
}

#ifdef FMI3
P(Status)
fmi3GetFloat64(instance_t instance, const reference_t of[], size_t count, real_t found[] COUNTED)
#else
P(Status)
fmi2GetReal(instance_t instance, const reference_t of[], size_t count, real_t found[])
#endif
{
  for (size_t at = 0; at < count; ++at) {
    if (of[at] >= COUNT) {
      return P(Error);
    }
    found[at] = ((ball_t*)instance)->value[of[at]];
  }
  return P(OK);
}

#ifdef FMI3
P(Status)
fmi3SetFloat64(instance_t instance, const reference_t of[], size_t count, const real_t given[] COUNTED)
#else
P(Status)
fmi2SetReal(instance_t instance, const reference_t of[], size_t count, const real_t given[])
#endif
{
  for (size_t at = 0; at < count; ++at) {
    if (of[at] >= COUNT) {
      return P(Error);
    }
    ((ball_t*)instance)->value[of[at]] = given[at];
  }
  return P(OK);
}

P(Status) P(GetContinuousStates)(instance_t instance, real_t states[], size_t count) {
  memcpy(states, instance, count * sizeof(real_t));
  return P(OK);
}

P(Status) P(SetContinuousStates)(instance_t instance, const real_t states[], size_t count) {
  memcpy(instance, states, count * sizeof(real_t));
  return P(OK);
}

#ifdef FMI3
P(Status)
fmi3GetContinuousStateDerivatives(instance_t instance, real_t found[], size_t count)
#else
P(Status)
fmi2GetDerivatives(instance_t instance, real_t found[], size_t count)
#endif
{
  ball_t* ball = instance;
  if (ball->value[PUSH] > 50.0) { /* more than its motor can */
    return P(Error);
  }
  found[0] = ball->rests ? 0.0 : ball->value[SPEED];
  found[1] = ball->rests ? 0.0 : ball->value[PUSH] - 9.81 - 0.1 * ball->value[SPEED];
  return P(OK);
}

P(Status) P(GetNominalsOfContinuousStates)(instance_t instance, real_t found[], size_t count) {
  found[0] = found[1] = 1.0;
  return P(OK);
}

P(Status) P(GetEventIndicators)(instance_t instance, real_t found[], size_t count) {
  ball_t* ball = instance;
  found[0] = ball->rests ? 1.0 : ball->value[HEIGHT];
  return P(OK);
}

static void bounce(ball_t* ball) {
  if (ball->value[HEIGHT] <= 0.0 && ball->value[SPEED] < 0.0) {
    ball->value[HEIGHT] = 1e-9;
    ball->value[SPEED] *= -ball->value[BOUNCE];
    ball->rests = ball->value[SPEED] < 0.05;
  }
  if (ball->rests) {
    ball->value[SPEED] = 0.0;
    ball->rests = ball->value[PUSH] <= 9.81;
  }
}

#ifdef FMI3
fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean* again, fmi3Boolean* ends, fmi3Boolean* nominals,
                                    fmi3Boolean* states, fmi3Boolean* defined, fmi3Float64* at) {
  bounce(instance);
  *again = *ends = *nominals = *states = *defined = fmi3False;
  *at = 0.0;
  return fmi3OK;
}
#else
fmi2Status fmi2NewDiscreteStates(fmi2Component instance, fmi2EventInfo* found) {
  bounce(instance);
  memset(found, 0, sizeof(*found));
  return fmi2OK;
}
#endif
