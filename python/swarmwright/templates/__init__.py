"""Commented experiment files to start from, one file for each."""

from importlib.resources import files

from swarmwright.core.errors import InputError
from swarmwright.core.suggestions import unknown


def names() -> list[str]:
    """Return the names of all templates, sorted."""
    return sorted(
        entry.name.removesuffix(".yaml")
        for entry in files(__name__).iterdir()
        if entry.name.endswith(".yaml")
    )


def text(name: str) -> str:
    """Return the experiment file of a template; raise InputError for an unknown one."""
    if name not in names():
        raise InputError(unknown("template", name, names()))
    return files(__name__).joinpath(f"{name}.yaml").read_text(encoding="utf-8")


def minisim() -> str:
    """Return the published Minisim example: one agent has to pass one defender and reach the goal."""
    return text("minisim")


def emergency_exit() -> str:
    """Return Emergency Exit on ten of FREVO's random fields: ten agents, five exits, twenty blockades."""
    return text("emergency_exit")


def arena() -> str:
    """Return aggregation with ambient cues in the arena: e-pucks gather on a black spot."""
    return text("arena")
