"""Experiments: reading and checking them, with the line of every error; their schema and reference."""
