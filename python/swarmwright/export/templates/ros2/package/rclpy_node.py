# @mark@; changes here are lost.
"""The node with rclpy. Its parameter `mapping` is the YAML file with topics of sensors and actuators."""

import sys

import rclpy
from rclpy.signals import SignalHandlerOptions

from .control import NAME, drive
from .exported import ACTUATORS, SENSORS, Controller
from .rclpy_middleware import Rclpy


def main() -> int:
    """Run until SIGINT or SIGTERM; return the exit status, 2 for a mistake in the mapping."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = rclpy.create_node(NAME)
        mapping = node.declare_parameter("mapping", "").value
        if not mapping:
            node.get_logger().error(
                "the parameter mapping is missing; controller.launch.py sets it, mapping:=FILE"
            )
            return 2
        return drive(Rclpy(node), mapping, Controller(), SENSORS, ACTUATORS)
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    sys.exit(main())
