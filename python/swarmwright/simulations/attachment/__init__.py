"""Robots in simulators that are attached and stepped from outside: what a file says of them, episodes."""
