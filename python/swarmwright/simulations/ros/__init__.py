"""Robots with ROS 1 or ROS 2: topics as sensors and actuators, and the middleware that carries them.

These modules need nothing but Python's standard library and the middleware that each is for. They run in the
Python that ROS was installed for, 3.8 or later, and exported packages have copies of them.
"""
