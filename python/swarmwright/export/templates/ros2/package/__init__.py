# @mark@; changes here are lost.
"""An evolved controller, and nodes that run it: with ROS 2 (`rclpy_node`) and without it (`dds_node`)."""
