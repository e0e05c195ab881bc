/* Two robots on lines, whose inputs are one array, for model exchange of FMI 3.0: see built.py beside the tests. */

#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"

enum { ROBOTS = 2, PLACES = 0, SPEEDS = 2 };

typedef struct {
  double places[ROBOTS], speeds[ROBOTS];
} pull_t;

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String path, fmi3Boolean visible,
                                          fmi3Boolean log, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback message) {
  return calloc(1, sizeof(pull_t));
}

void fmi3FreeInstance(fmi3Instance instance) { free(instance); }

fmi3Status fmi3Reset(fmi3Instance instance) {
  memset(instance, 0, sizeof(pull_t));
  return fmi3OK;
}

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference of[], size_t count, fmi3Float64 values[],
                          size_t size) {
  pull_t* pull = instance;
  if (of[0] == SPEEDS) {
    memcpy(values, pull->speeds, sizeof(pull->speeds));
    return fmi3OK;
  }
  for (size_t at = 0; at < count; ++at) {
    values[at] = pull->places[of[at]];
  }
  return fmi3OK;
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference of[], size_t count,
                          const fmi3Float64 values[], size_t size) {
  memcpy(((pull_t*)instance)->speeds, values, sizeof(((pull_t*)instance)->speeds));
  return fmi3OK;
}

fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 states[], size_t count) {
  memcpy(states, ((pull_t*)instance)->places, count * sizeof(double));
  return fmi3OK;
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 states[], size_t count) {
  memcpy(((pull_t*)instance)->places, states, count * sizeof(double));
  return fmi3OK;
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 found[], size_t count) {
  memcpy(found, ((pull_t*)instance)->speeds, count * sizeof(double));
  return fmi3OK;
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 found[], size_t count) {
  found[0] = found[1] = 1.0;
  return fmi3OK;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean* again, fmi3Boolean* ends, fmi3Boolean* nominals,
                                    fmi3Boolean* states, fmi3Boolean* defined, fmi3Float64* at) {
  *again = *ends = *nominals = *states = *defined = fmi3False;
  *at = 0.0;
  return fmi3OK;
}
