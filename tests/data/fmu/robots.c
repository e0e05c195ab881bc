/* Robots on a plane as arrays, for co-simulation of FMI 3.0: see built.py beside the tests. */

#include <stdlib.h>

#include "fmi3Functions.h"

enum { TIME, PLACES, SPEEDS, DONE, ROBOTS = 3 };

typedef struct {
  double places[ROBOTS * 2], speeds[ROBOTS * 2];
} robots_t;

static void start(robots_t* robots) {
  for (int at = 0; at < 2 * ROBOTS; ++at) {
    robots->places[at] = 0.25 * at;
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

static double* found(robots_t* robots, fmi3ValueReference reference) {
  return reference == PLACES ? robots->places : reference == SPEEDS ? robots->speeds : NULL;
}

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference of[], size_t count, fmi3Float64 values[],
                          size_t size) {
  double* array = count == 1 && size == 2 * ROBOTS ? found(instance, of[0]) : NULL;
  for (size_t at = 0; array && at < size; ++at) {
    values[at] = array[at];
  }
  return array ? fmi3OK : fmi3Error;
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference of[], size_t count,
                          const fmi3Float64 values[], size_t size) {
  double* array = count == 1 && size == 2 * ROBOTS ? found(instance, of[0]) : NULL;
  for (size_t at = 0; array && at < size; ++at) {
    array[at] = values[at];
  }
  return array ? fmi3OK : fmi3Error;
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 now, fmi3Float64 size, fmi3Boolean keep, fmi3Boolean* event,
                      fmi3Boolean* ends, fmi3Boolean* early, fmi3Float64* last) {
  robots_t* robots = instance;
  for (int at = 0; at < 2 * ROBOTS; ++at) {
    robots->places[at] += size * robots->speeds[at];
  }
  *event = *ends = *early = fmi3False;
  *last = now + size;
  return fmi3OK;
}
