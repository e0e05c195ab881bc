"""Evolving: the loop of generations, steady-state evolution, resuming."""
