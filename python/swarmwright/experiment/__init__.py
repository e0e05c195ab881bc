"""Experiments: reading and checking them, with the place of every mistake; their schema and reference."""
