// Includes the exported source itself: after another export only this file is compiled again.
#include "exported.h"

#include "controller.c"

static controller_t controller;

const int exported_sensors = CONTROLLER_SENSORS;
const int exported_actuators = CONTROLLER_ACTUATORS;

void exported_reset(void) { controller_reset(&controller); }

bool exported_step(const float* sensors, float* actuators) { return controller_step(&controller, sensors, actuators); }
