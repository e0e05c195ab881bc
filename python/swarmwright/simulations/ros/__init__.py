"""Robots with ROS 1 or ROS 2: topics as sensors and actuators, over different middleware.

These modules need only Python's standard library and their middleware. They run in the Python that ROS was
installed for, 3.8 or later, and exported packages contain copies of them.
"""
