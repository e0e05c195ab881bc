"""Servers that launchers start on this or other machines for the duration of a run."""

from swarmwright.servers.evaluation.launched.servers import LaunchedServers
from swarmwright.servers.evaluation.launched.starting import start

__all__ = ["LaunchedServers", "start"]
