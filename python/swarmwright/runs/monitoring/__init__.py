"""Metrics of a running process for Prometheus."""
