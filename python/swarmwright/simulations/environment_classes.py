"""Classes of environments that are named as if they were simulations, `my_world.py:Maze`."""

import sys

from swarmwright.common.simulation_names import SimulationName

_GUIDE = "see docs/how-to/use-environments.md"


def as_environment(found: object, name: str) -> str:
    """Return how an environment of Gymnasium or PettingZoo is named instead, empty for any other object.

    Args:
        found: what has the name.
        name: of its file or module, and of the class.
    """
    if not isinstance(found, type):
        return ""
    parsed = SimulationName.parse(name)
    module = parsed.module if parsed.file is None else parsed.file.stem
    for base in found.__mro__:
        library = base.__module__.partition(".")[0]
        if library == "gymnasium" and base.__name__ == "Env":
            return _of_gymnasium(found, module, parsed.member)
        if library == "pettingzoo" and base.__name__ in {"ParallelEnv", "AECEnv"}:
            return (
                f"is an environment of PettingZoo, which needs no class of a simulation: let parallel_env() "
                f"of the module return one, and write pettingzoo:{module}; {_GUIDE}"
            )
    return ""


def _of_gymnasium(found: type, module: str, member: str) -> str:
    """Return the name under which it is registered, or else how that is done."""
    what = "is an environment of Gymnasium, which needs no class of a simulation"
    entry = f"{module}:{member}"
    # It is imported, as its class is derived from one of it.
    for one, spec in sys.modules["gymnasium"].registry.items():
        if spec.entry_point in {found, entry}:
            return f"{what}: write gymnasium:{module}:{one}; {_GUIDE}"
    return (
        f"{what}: register it in its module, gymnasium.register('{member}-v0', entry_point='{entry}'), and "
        f"write gymnasium:{module}:{member}-v0; {_GUIDE}"
    )
