"""SCXML state machines: the behaviour of agents."""

from pathlib import Path

from swarmwright.controllers import scxml
from swarmwright.interop.models._parts import Part

ROOTS = ("scxml",)
WORDS = "a state machine in SCXML (<scxml>)"


def load(path: Path) -> Part:
    """Read a state machine. Raises InputError with all problems, each with file and line."""
    machine = scxml.read(path)
    return Part(path, WORDS, name=machine.name, behaviour=machine)
