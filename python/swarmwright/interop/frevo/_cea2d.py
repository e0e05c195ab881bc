"""FREVO's CEA2D: its entries as options of Swarmwright."""

from swarmwright.interop.frevo._document import Section
from swarmwright.interop.frevo._mapped import Line, Mapped

_PATTERNS = (1, 2, 3)
_PATTERN_SIZE = 10  # cells in either direction that a pattern of obstacles takes


def map_cea2d(method: Section, mapped: Mapped) -> None:
    """Map every entry. Raises InputError for one that cannot be read or has no counterpart."""
    add = mapped.method.append
    add(Line("generations", method.take_integer("generations", 200, 1), "generations"))
    width = method.take_integer("populationsize_width", 10, 1)
    height = method.take_integer("populationsize_height", 10, 1)
    add(Line("width", width, "populationsize_width"))
    add(Line("height", height, "populationsize_height"))
    mode = method.take_integer("neighbourhoodmode", 1)
    # FREVO takes any other number for 1.
    add(Line("neighbourhood", "random" if mode == 2 else "grid", f"neighbourhoodmode = {mode}"))
    _map_obstacles(method, mapped, min(width, height))
    _map_shares(method, mapped)
    add(Line("severity", method.take_number("mutationseverity", 0.3), "mutationseverity"))
    add(Line("probability", method.take_number("mutationprobability", 1.0), "mutationprobability"))
    interval = method.take_integer("saveinterval", 0)
    mapped.not_method.append(f"saveinterval = {interval}: the record of a run holds every evaluation")
    mapped.mutation = Line("mutation", "uniform", "CEA2D knows no other")


def _map_obstacles(method: Section, mapped: Mapped, side: int) -> None:
    pattern = method.take_integer("obstacle-pattern", 0)
    obstacles = method.take_integer("random obstacles", 0, 0)
    if pattern in _PATTERNS and side >= _PATTERN_SIZE:
        raise method.error(
            "obstacle-pattern", f"{pattern} found; obstacles here are random ones: set it to 4 in FREVO"
        )
    if pattern in _PATTERNS:  # FREVO omits it for lack of space
        obstacles = 0
    mapped.method.append(Line("obstacles", obstacles, f"random obstacles; obstacle-pattern = {pattern}"))


def _map_shares(method: Section, mapped: Mapped) -> None:
    """Map shares of a hundred: FREVO gives renewal what elite, mutation and crossover leave."""
    left = 100
    for ours, key, default in (
        ("elite", "percentelite", 11),
        ("mutate", "percentmutateelite", 59),
        ("crossover", "percentxoverelite", 30),
    ):
        given = method.take_integer(key, default, 0)
        share = min(given, left)
        left -= share
        comment = key if share == given else f"{key} = {given}, of which FREVO takes what is left of 100"
        mapped.method.append(Line(ours, share / 100, comment))
    mapped.method.append(Line("renew", left / 100, "what the others leave"))
