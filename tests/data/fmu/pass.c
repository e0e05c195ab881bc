/* An FMU of FMI 2.0 whose outputs are its inputs: see built.py beside the tests.

   Two value references after each other, 0 and 1, 2 and 3, .., are an input and its output. */

#include <stdlib.h>

#include "fmi2Functions.h"

enum { PAIRS = 8 };

typedef struct {
  double reals[PAIRS];
  int integers[PAIRS], booleans[PAIRS];
} values_t;

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type kind, fmi2String token, fmi2String path,
                              const fmi2CallbackFunctions* functions, fmi2Boolean visible, fmi2Boolean log) {
  return calloc(1, sizeof(values_t));
}

void fmi2FreeInstance(fmi2Component instance) { free(instance); }

#define ACCESS(kind, type, field)                                                                             \
  fmi2Status fmi2Get##kind(fmi2Component of, const fmi2ValueReference at[], size_t count, type found[]) {     \
    for (size_t one = 0; one < count; ++one) found[one] = ((values_t*)of)->field[at[one] / 2];                \
    return fmi2OK;                                                                                            \
  }                                                                                                           \
  fmi2Status fmi2Set##kind(fmi2Component of, const fmi2ValueReference at[], size_t count, const type put[]) { \
    for (size_t one = 0; one < count; ++one) ((values_t*)of)->field[at[one] / 2] = put[one];                  \
    return fmi2OK;                                                                                            \
  }

ACCESS(Real, fmi2Real, reals)
ACCESS(Integer, fmi2Integer, integers)
ACCESS(Boolean, fmi2Boolean, booleans)

/* For the list of functions that are written here: fmi2GetReal fmi2SetReal fmi2GetInteger fmi2SetInteger
   fmi2GetBoolean fmi2SetBoolean */
