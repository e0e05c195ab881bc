/* An integrator of FMI 2.0 that takes all its memory from the importer: see built.py beside the tests.

   Its reset does nothing, as in FMUs of some tools. */

#include <stdint.h>
#include <string.h>

#include "fmi2Functions.h"

enum { INPUT, TOTAL, SOUND, MODE };
enum { CALM, LATE, FAILING, SILENT };

typedef struct {
  double input, time, *total; /* total: in a block of its own */
  int mode, is_sound, questions;
  const fmi2CallbackFunctions* functions;
  char name[100];
} integrator_t;

static int instances;

/* Whether the importer's memory is what section 2.1.5 says. */
static int is_sound(const fmi2CallbackFunctions* functions) {
  enum { BLOCKS = 100, BYTES = 4000 };
  char* blocks[BLOCKS];
  int found = functions->allocateMemory(SIZE_MAX / 2, 4) == NULL;
  for (int at = 0; at < BLOCKS; ++at) {
    blocks[at] = functions->allocateMemory(BYTES / 8, 8);
    for (int byte = 0; byte < BYTES; ++byte) {
      found &= blocks[at][byte] == 0;
    }
    memset(blocks[at], at + 1, BYTES);
  }
  for (int at = 0; at < BLOCKS; ++at) {
    found &= blocks[at][0] == at + 1 && blocks[at][BYTES - 1] == at + 1;
    functions->freeMemory(blocks[at]);
  }
  functions->freeMemory(NULL);
  return found;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type kind, fmi2String token, fmi2String path,
                              const fmi2CallbackFunctions* functions, fmi2Boolean visible, fmi2Boolean log) {
  if (functions->allocateMemory == NULL || functions->freeMemory == NULL) {
    return NULL;
  }
  if (instances++ > 0 && strcmp(token, "once") == 0) {
    functions->logger(functions->componentEnvironment, name, fmi2Error, "error", "there was one before");
    return NULL;
  }
  integrator_t* made = functions->allocateMemory(1, sizeof(integrator_t));
  made->functions = functions;
  made->is_sound = made->mode == CALM && is_sound(functions);
  made->total = functions->allocateMemory(1, sizeof(double));
  strncpy(made->name, name, sizeof(made->name) - 1);
  return made;
}

void fmi2FreeInstance(fmi2Component instance) {
  integrator_t* of = instance;
  of->functions->freeMemory(of->total);
  of->functions->freeMemory(of);
}

static double* place(integrator_t* of, fmi2ValueReference reference) {
  return reference == INPUT ? &of->input : of->total;
}

fmi2Status fmi2GetReal(fmi2Component instance, const fmi2ValueReference of[], size_t count, fmi2Real found[]) {
  for (size_t at = 0; at < count; ++at) {
    found[at] = of[at] == SOUND ? ((integrator_t*)instance)->is_sound : *place(instance, of[at]);
  }
  return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component instance, const fmi2ValueReference of[], size_t count,
                       const fmi2Real given[]) {
  for (size_t at = 0; at < count; ++at) {
    *place(instance, of[at]) = given[at];
  }
  return fmi2OK;
}

fmi2Status fmi2SetInteger(fmi2Component instance, const fmi2ValueReference of[], size_t count,
                          const fmi2Integer given[]) {
  ((integrator_t*)instance)->mode = given[0];
  return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component instance, fmi2Real time, fmi2Real size, fmi2Boolean is_past) {
  integrator_t* of = instance;
  const fmi2CallbackFunctions* functions = of->functions;
  double* total = functions->allocateMemory(1, sizeof(double)); /* in each step another one */
  *total = *of->total + size * of->input;
  functions->freeMemory(of->total);
  of->total = total;
  of->questions = 3;
  if (of->mode >= FAILING) {
    functions->logger(of->mode == SILENT ? NULL : functions->componentEnvironment, of->name, fmi2Error, "error",
                      "#r%d# of %s is %.2f, that is %d%% ##", TOTAL, of->name, *total, (int)(100.0 * *total));
    return fmi2Error;
  }
  return of->mode == LATE ? fmi2Pending : fmi2OK;
}

fmi2Status fmi2GetStatus(fmi2Component instance, const fmi2StatusKind kind, fmi2Status* found) {
  integrator_t* of = instance;
  *found = kind == fmi2DoStepStatus && of->questions-- > 0 ? fmi2Pending : fmi2OK;
  return fmi2OK;
}

/* For model exchange. */
fmi2Status fmi2GetContinuousStates(fmi2Component instance, fmi2Real states[], size_t count) {
  states[0] = *((integrator_t*)instance)->total;
  return fmi2OK;
}

fmi2Status fmi2SetContinuousStates(fmi2Component instance, const fmi2Real states[], size_t count) {
  *((integrator_t*)instance)->total = states[0];
  return fmi2OK;
}

fmi2Status fmi2GetDerivatives(fmi2Component instance, fmi2Real found[], size_t count) {
  found[0] = ((integrator_t*)instance)->input;
  return fmi2OK;
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component instance, fmi2Real found[], size_t count) {
  found[0] = 1.0;
  return fmi2OK;
}
