"""Simulations: the built-in ones by name, and those that users write in Python."""
