/*
@facts@
 */
#include "exported.h"

#include "@p@.c"

static @p@_t controller;

const int exported_sensors = @PREFIX@_SENSORS;
const int exported_actuators = @PREFIX@_ACTUATORS;

const char *const exported_sensor_names[] = {
@sensor_names@
};

const char *const exported_actuator_names[] = {
@actuator_names@
};

void exported_reset(void) { @p@_reset(&controller); }

bool exported_step(const float *sensors, float *actuators) { return @p@_step(&controller, sensors, actuators); }
