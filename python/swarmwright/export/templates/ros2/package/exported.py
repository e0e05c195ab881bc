# @mark@; changes here are lost.
"""The controller, with names by which a mapping tells its sensors and actuators apart."""

from .@p@ import Controller

SENSORS = [
@sensor_names@
]
ACTUATORS = [
@actuator_names@
]

__all__ = ["ACTUATORS", "SENSORS", "Controller"]
