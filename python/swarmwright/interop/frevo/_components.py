"""FREVO's components that have a counterpart here."""

from collections.abc import Callable, Sequence

from swarmwright.common.errors import InputError
from swarmwright.common.suggestions import did_you_mean
from swarmwright.interop.frevo._document import Section

EMERGENCY_EXIT = "emergencyexit.EmergencyExit"
MESHED = "fullyMeshedNet.FullyMeshedNet"
COMPLETE = "completeNetwork.CompleteNetwork"
THREE_LAYERS = "threeLayerNetwork.ThreeLayerNetwork"
LAYERS = "multiLayerNetwork.MultiLayerNetwork"
MACHINE = "fsm.MealyFSM"
HEBBIAN = "hebbNet.HebbNet"
NEAT = "neat.NEAT"
NNGA, CEA2D, PSO = "nnga.NNGA", "CEA2D.CEA2D", "pso.PSO"
RANDOM_SEARCH = "frevo.method.randomsearch.RandomSearch"

KNOWN = {
    "problem": (EMERGENCY_EXIT,),
    "method": (NNGA, CEA2D, PSO, RANDOM_SEARCH),
    "representation": (MESHED, COMPLETE, THREE_LAYERS, LAYERS, MACHINE, HEBBIAN, NEAT),
    "ranking": ("AbsoluteRanking.AbsoluteRanking",),
}
"""Classes of each section that have a counterpart here."""

OPTIONS = {
    "problem": ("simulation", "a simulation"),
    "method": ("method", "a method"),
    "representation": ("controller", "a controller"),
    "ranking": ("ranking", "a ranking"),
}
"""For each section the option that names something of this program in the component's place, and what."""


def check(section: Section, *, replaceable: bool) -> None:
    """Raise InputError when the component that a section names has no counterpart here.

    replaceable: whether another component can replace it, which the message then says.
    """
    known = KNOWN[section.name]
    if section.class_name in known:
        return
    option, what = OPTIONS[section.name]
    instead = f"; --{option} names {what} to take in its place" if replaceable else ""
    raise section.element.error(
        f"the class {section.class_name!r} has no counterpart here"
        f"{did_you_mean(section.class_name, known)}; what can be taken over is {_any_of(known)}{instead}"
    )


def all_of(*steps: Callable[[], None]) -> None:
    """Take every step; raise one InputError with the problems of all, a line each."""
    problems = []
    for step in steps:
        try:
            step()
        except InputError as error:
            problems.append(str(error))
    if problems:
        raise InputError("\n".join(dict.fromkeys(problems)))


def _any_of(names: Sequence[str]) -> str:
    *most, last = names
    return f"{', '.join(most)} or {last}" if most else last
