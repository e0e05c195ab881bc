"""Runs: folder and store, code, export, comparison, repetition, and evaluation of their results."""
