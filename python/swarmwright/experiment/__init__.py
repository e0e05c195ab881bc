"""Experiment files: reading, checking, schema and reference."""
