"""FMUs of whole swarms: variables named `agent[1].NAME`, `agent[2].NAME`, .., as `export-fmu` writes them."""

import re
from collections.abc import Mapping
from dataclasses import dataclass

from swarmwright.simulations.fmu.description import Description

AGENT = "{agent}"
"""Stands for an agent's number, from 1, in names of variables."""
_OF_AGENT = re.compile(r"agent\[(\d{1,9})\]\.(.+)")
_ACTS = "acts"
_METRICS = "metrics."


@dataclass(frozen=True)
class Layout:
    """What the variables of such an FMU are."""

    agents: int
    sensors: list[str]
    """Names with {agent}."""
    actuators: list[str]
    acts: str | None
    """The output that says whether an agent acts, with {agent}; None: all of them always do."""
    metrics: Mapping[str, str]
    """Variable of each metric."""
    fitness: str | None
    """The output that is the fitness."""
    done: str | None
    """The output that says that the episode has ended."""


def layout(description: Description) -> Layout | None:
    """Return the layout of an FMU; None where its outputs have no names of agents."""
    outputs, inputs = (
        [one.name for one in description.of_causality(causality)] for causality in ("output", "input")
    )
    numbers = {int(found[1]) for found in map(_OF_AGENT.fullmatch, outputs) if found is not None}
    agents = next(number for number in range(1, len(numbers) + 2) if number not in numbers) - 1
    if not agents:
        return None
    sensors, actuators = (_of_first(names) for names in (outputs, inputs))
    known = description.variables
    return Layout(
        agents,
        [f"agent[{AGENT}].{name}" for name in sensors if name != _ACTS],
        [f"agent[{AGENT}].{name}" for name in actuators],
        f"agent[{AGENT}].{_ACTS}" if _ACTS in sensors else None,
        {name.removeprefix(_METRICS): name for name in outputs if name.startswith(_METRICS)},
        "fitness" if "fitness" in outputs else None,
        "done" if "done" in outputs and known["done"].type == "Boolean" else None,
    )


def stop_time(description: Description) -> float | None:
    """Return when episodes of an FMU end; None where it does not say so beforehand.

    An exported simulation says it by its output `done`: its stop time is that of the parameters at the
    export, and others can make episodes longer.
    """
    found = layout(description) if description.is_exported else None
    return description.stop_time if found is None or found.done is None else None


def _of_first(names: list[str]) -> list[str]:
    found = map(_OF_AGENT.fullmatch, names)
    return [one[2] for one in found if one is not None and one[1] == "1"]
