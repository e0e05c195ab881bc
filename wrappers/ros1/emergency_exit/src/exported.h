// The exported controller of this program, whatever its prefix and its size.
#pragma once

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

extern const int exported_sensors;
extern const int exported_actuators;

// Goes to the start of an episode.
void exported_reset(void);

// Computes the actuators; false when a sensor is NaN or infinite.
bool exported_step(const float* sensors, float* actuators);

#ifdef __cplusplus
}
#endif
