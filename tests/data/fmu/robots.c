/* Robots on a plane as arrays, for co-simulation of FMI 3.0: see built.py beside the tests. */

#include <stdlib.h>

#include "fmi3Functions.h"

enum { TIME, PLACES, SPEEDS, COUNT, FROM, ROBOTS = 3, MOST = 16 };

typedef struct {
  double places[MOST * 2], speeds[MOST * 2], from[MOST * 2];
  size_t count;
  int configuring;
} robots_t;

static void start(robots_t* robots) {
  robots->count = ROBOTS;
  for (int at = 0; at < 2 * MOST; ++at) {
    robots->from[at] = 0.25 * at;
    robots->speeds[at] = 0.0;
  }
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String path, fmi3Boolean visible,
                                         fmi3Boolean log, fmi3Boolean events, fmi3Boolean early,
                                         const fmi3ValueReference needed[], size_t count,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback message,
                                         fmi3IntermediateUpdateCallback update) {
  robots_t* robots = calloc(1, sizeof(robots_t));
  start(robots);
  return robots;
}

void fmi3FreeInstance(fmi3Instance instance) { free(instance); }

fmi3Status fmi3Reset(fmi3Instance instance) {
  start(instance);
  return fmi3OK;
}

fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance) {
  ((robots_t*)instance)->configuring = 1;
  return fmi3OK;
}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance) {
  ((robots_t*)instance)->configuring = 0;
  return fmi3OK;
}

fmi3Status fmi3SetUInt64(fmi3Instance instance, const fmi3ValueReference of[], size_t count, const fmi3UInt64 values[],
                         size_t size) {
  robots_t* robots = instance;
  if (!robots->configuring || of[0] != COUNT || values[0] > MOST) {
    return fmi3Error;
  }
  robots->count = values[0];
  return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) {
  robots_t* robots = instance;
  for (int at = 0; at < 2 * MOST; ++at) {
    robots->places[at] = robots->from[at];
  }
  return fmi3OK;
}

static double* found(robots_t* robots, fmi3ValueReference reference) {
  return reference == PLACES   ? robots->places
         : reference == SPEEDS ? robots->speeds
         : reference == FROM   ? robots->from
                               : NULL;
}

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference of[], size_t count, fmi3Float64 values[],
                          size_t size) {
  size_t all = 2 * ((robots_t*)instance)->count;
  double* array = count == 1 && size == all ? found(instance, of[0]) : NULL;
  for (size_t at = 0; array && at < size; ++at) {
    values[at] = array[at];
  }
  return array ? fmi3OK : fmi3Error;
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference of[], size_t count,
                          const fmi3Float64 values[], size_t size) {
  size_t all = 2 * ((robots_t*)instance)->count;
  double* array = count == 1 && size == all ? found(instance, of[0]) : NULL;
  for (size_t at = 0; array && at < size; ++at) {
    array[at] = values[at];
  }
  return array ? fmi3OK : fmi3Error;
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 now, fmi3Float64 size, fmi3Boolean keep, fmi3Boolean* event,
                      fmi3Boolean* ends, fmi3Boolean* early, fmi3Float64* last) {
  robots_t* robots = instance;
  for (size_t at = 0; at < 2 * robots->count; ++at) {
    robots->places[at] += size * robots->speeds[at];
  }
  *event = *ends = *early = fmi3False;
  *last = now + size;
  return fmi3OK;
}
