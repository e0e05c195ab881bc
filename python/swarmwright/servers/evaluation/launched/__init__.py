"""Servers that launchers start, here or elsewhere, for the time of a run."""

from swarmwright.servers.evaluation.launched.servers import LaunchedServers
from swarmwright.servers.evaluation.launched.starting import start

__all__ = ["LaunchedServers", "start"]
