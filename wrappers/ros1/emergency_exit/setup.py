"""For catkin, which makes the module `emergency_exit` importable; do not run this."""

from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import setup

setup(**generate_distutils_setup(packages=["emergency_exit"], package_dir={"": "src"}))
