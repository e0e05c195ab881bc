"""Titles that were meant where a simulation is not known."""

from swarmwright.core.simulation_names import SIMULATORS
from swarmwright.core.suggestions import did_you_mean
from swarmwright.simulations.catalogue import is_here, titles


def alike(simulation: str) -> str:
    """Return "; did you mean 'x'?" for a title near a known one: built in, or of another simulator.

    Empty for a title that is known, and where none is near.
    """
    known = (*titles(), *SIMULATORS)
    return "" if is_here(simulation) or simulation in known else did_you_mean(simulation, known)


def not_here(simulation: str) -> str:
    """Say that this process cannot run a simulation of this title, and what there is."""
    if simulation in SIMULATORS:
        return (
            f"{simulation!r} is not built in: servers of another simulator offer it, see "
            f"{SIMULATORS[simulation]}"
        )
    return f"unknown simulation {simulation!r}{alike(simulation) or ';'} available: {', '.join(titles())}"
