"""Simulations that users write in Python."""
