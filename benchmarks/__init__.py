"""Benchmarks: Swarmwright against clients as thin as they can be, through the same broker, in the same run.

`make bench`, or `python -m benchmarks build/bench.json`; docs/explanation/performance.md explains them.
"""
