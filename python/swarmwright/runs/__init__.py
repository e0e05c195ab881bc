"""Runs: folder and store, code, export, comparison, repetition, and the evaluation of what they found."""
