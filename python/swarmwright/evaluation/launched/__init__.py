"""Servers that launchers start, here or elsewhere, for the time of a run."""

from swarmwright.evaluation.launched.servers import LaunchedServers
from swarmwright.evaluation.launched.starting import start

__all__ = ["LaunchedServers", "start"]
