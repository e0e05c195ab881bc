"""What whole systems have: brokers, programs, experiments."""

from tests.system.conftest import cleanup, embedded, experiment, launch

__all__ = ["cleanup", "embedded", "experiment", "launch"]
