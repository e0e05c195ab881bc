"""Shared basics: errors, YAML with line numbers, options, registries of plug-ins, random numbers, texts.

Nothing in this package imports another part of Swarmwright, except `typing` and the engine.
"""
