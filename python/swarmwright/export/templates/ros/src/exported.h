// @mark@; changes here are lost.
// The exported controller, independent of its prefix and its size.
#pragma once

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

extern const int exported_sensors;
extern const int exported_actuators;
extern const char* const exported_sensor_names[];
extern const char* const exported_actuator_names[];

// Starts an episode: clears the state.
void exported_reset(void);

// Computes the actuators for one control cycle; returns false if it refuses a step, see its header.
bool exported_step(const float* sensors, float* actuators);

#ifdef __cplusplus
}
#endif
