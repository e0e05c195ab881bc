/* Holds a value of each type, for co-simulation of FMI 3.0: see built.py beside the tests. */

#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"

enum { MOST = 16, WIDE = 2 };

typedef struct {
  fmi3UInt8 bytes[MOST];
  fmi3Int8 small[MOST];
  fmi3UInt64 large[MOST];
  fmi3Int64 items[MOST];
  fmi3Boolean flags[MOST][WIDE];
  fmi3LogMessageCallback log;
} types_t;

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String path, fmi3Boolean visible,
                                         fmi3Boolean log, fmi3Boolean events, fmi3Boolean early,
                                         const fmi3ValueReference needed[], size_t count,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback message,
                                         fmi3IntermediateUpdateCallback update) {
  types_t* types = calloc(1, sizeof(types_t));
  types->log = log ? message : NULL;
  return types;
}

void fmi3FreeInstance(fmi3Instance instance) { free(instance); }

#define VALUES(TYPE, GET, SET, FIELD)                                                                              \
  fmi3Status GET(fmi3Instance instance, const fmi3ValueReference of[], size_t count, TYPE values[], size_t size) { \
    for (size_t at = 0; at < count; ++at) {                                                                        \
      values[at] = ((types_t*)instance)->FIELD[of[at]];                                                            \
    }                                                                                                              \
    return fmi3OK;                                                                                                 \
  }                                                                                                                \
  fmi3Status SET(fmi3Instance instance, const fmi3ValueReference of[], size_t count, const TYPE values[],          \
                 size_t size) {                                                                                    \
    for (size_t at = 0; at < count; ++at) {                                                                        \
      ((types_t*)instance)->FIELD[of[at]] = values[at];                                                            \
    }                                                                                                              \
    return fmi3OK;                                                                                                 \
  }

VALUES(fmi3UInt8, fmi3GetUInt8, fmi3SetUInt8, bytes)
VALUES(fmi3Int8, fmi3GetInt8, fmi3SetInt8, small)
VALUES(fmi3UInt64, fmi3GetUInt64, fmi3SetUInt64, large)
VALUES(fmi3Int64, fmi3GetInt64, fmi3SetInt64, items)

fmi3Status fmi3GetBoolean(fmi3Instance instance, const fmi3ValueReference of[], size_t count, fmi3Boolean values[],
                          size_t size) {
  memcpy(values, ((types_t*)instance)->flags[of[0]], size * sizeof(fmi3Boolean));
  return fmi3OK;
}

fmi3Status fmi3SetBoolean(fmi3Instance instance, const fmi3ValueReference of[], size_t count,
                          const fmi3Boolean values[], size_t size) {
  memcpy(((types_t*)instance)->flags[of[0]], values, size * sizeof(fmi3Boolean));
  return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 now, fmi3Float64 size, fmi3Boolean keep, fmi3Boolean* event,
                      fmi3Boolean* ends, fmi3Boolean* early, fmi3Float64* last) {
  types_t* types = instance;
  *event = *ends = *early = fmi3False;
  *last = now + size;
  if (types->log) {
    types->log(NULL, fmi3OK, "steps", "a step is done");
    types->log(NULL, fmi3Warning, "steps", "the step was hard");
  }
  if (types->bytes[1] == 13 && types->log) {
    types->log(NULL, fmi3Error, "steps", "13 is a bad number");
  }
  return types->bytes[1] == 13 ? fmi3Error : fmi3OK;
}
