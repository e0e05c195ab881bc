"""FREVO's methods: their entries as options of Swarmwright."""

import math
from collections.abc import Callable

from swarmwright.interop.frevo._components import CEA2D, MACHINE, MESHED, NNGA, PSO, RANDOM_SEARCH
from swarmwright.interop.frevo._document import Section, Session
from swarmwright.interop.frevo._mapped import Line, Mapped

_SHARES = {
    "percentage_elite": ("elite", 0.15),
    "percentage_random": ("random", 0.10),
    "percentage_mutate": ("mutate", 0.40),
    "percentage_xover": ("crossover", 0.30),
    "percentage_renew": ("renew", 0.05),
}
_LARGEST_VELOCITY = 2.0
"""Largest step of a weight or bias in one generation of FREVO's PSO."""


def map_method(session: Session, mapped: Mapped) -> None:
    """Map every entry. Raises InputError for one that cannot be read or has no counterpart."""
    _MAPS[session.method.class_name](session, mapped)


def _map_cea2d(session: Session, mapped: Mapped) -> None:
    mapped.method_kind = "cea2d"
    map_cea2d(session.method, mapped)


def _map_nnga(session: Session, mapped: Mapped) -> None:
    method, add = session.method, mapped.method.append
    add(Line("population", method.take_integer("populationsize", 50, 2), "populationsize"))
    add(Line("generations", method.take_integer("generations", 200, 1), "generations"))
    shares = {ours: _share(method, key, default) for key, (ours, default) in _SHARES.items()}
    rest = 1 - math.fsum(share for name, share in shares.items() if name != "elite")
    comments = {ours: key for key, (ours, _) in _SHARES.items()}
    if any(_is_percentage(method, key) for key in _SHARES):
        mapped.notes.append(
            "method.percentage_..: whole numbers are percentages, as early versions of FREVO wrote them; "
            "FREVO 1.5 takes them for shares, and 15 for 1500 %"
        )
    if abs(rest - shares["elite"]) > 1e-6:
        comments["elite"] += f" = {shares['elite']!r}; FREVO gives the elite what the others leave"
        shares["elite"] = round(rest, 9)
    mapped.method += [Line(name, share, comments[name]) for name, share in shares.items()]
    add(Line("severity", method.take_number("mutationseverity", 0.3), "mutationseverity"))
    add(Line("probability", method.take_number("mutationprobability", 1.0), "mutationprobability"))
    crossover = method.take_integer("xoverMethod", 1)
    if crossover != 1 and session.representation.class_name != MACHINE:
        raise method.error("xoverMethod", f"{crossover} found; FREVO's networks know 1 only")
    mapped.not_method.append(f"xoverMethod = {crossover}: crossovers take runs of nodes, or of table rows")
    add(Line("populations", method.take_integer("populationnumber", 1, 1), "populationnumber"))
    every = method.take_integer("interXover_frequency", 10)
    # Java's remainder, which FREVO uses, is 0 for the same generations whatever the sign.
    add(Line("exchange_interval", abs(every), "interXover_frequency"))
    interval = method.take_integer("saveinterval", 0)
    improvements = method.take_flag("saveImprovements", True)
    mapped.not_method.append(
        f"saveinterval = {interval}, saveImprovements = {str(improvements).lower()}: "
        "the record of a run holds every evaluation"
    )
    number = method.take_integer("mutationMethod", 1)
    # FREVO takes any other number for 1.
    name = "proportional" if number == 2 else "uniform"
    mapped.mutation = Line("mutation", name, f"mutationMethod = {number}")


def _share(method: Section, key: str, default: float) -> float:
    """Return a share of the population, 0 to 1."""
    value = method.take_number(key, default)
    return value / 100 if _is_percentage(method, key) else value


def _is_percentage(method: Section, key: str) -> bool:
    """Return whether a share is written as a percentage, which early versions of FREVO did."""
    return key in method.entries and method.entries[key].attributes.get("type") == "INT"


def _map_random_search(session: Session, mapped: Mapped) -> None:
    mapped.method_kind = "random_search"
    method = session.method
    mapped.method += [
        Line("population", method.take_integer("populationsize", 50, 1), "populationsize"),
        Line("generations", method.take_integer("generations", 200, 1), "generations"),
    ]
    mapped.not_method.append(
        "the best candidate takes a place in FREVO's next population; here all are new, and the best is kept "
        "in the record"
    )


def _map_pso(session: Session, mapped: Mapped) -> None:
    mapped.method_kind = "pso"
    method, representation = session.method, session.representation
    add = mapped.method.append
    add(Line("population", method.take_integer("populationsize", 100, 3), "populationsize"))
    add(Line("generations", method.take_integer("generations", 200, 1), "generations"))
    for ours, key, default in (("inertia", "W", 0.7), ("own", "C1", 2.4), ("social", "C2", 2.1)):
        add(Line(ours, method.take_number(key, default), key))
    add(Line("adaptive", "false", "FREVO's inertia and pulls stay as they are"))
    add(Line("perturb", "false", "FREVO moves the best particle as all others"))
    # Both are looked at again with the representation: what is read twice is taken once.
    reach = representation.take_number("weight_range", 2.0)
    fastest = min(_LARGEST_VELOCITY / (2 * reach), 1.0) if reach > 0 else 1.0
    add(Line("reach", 1.0, "FREVO holds weights within weight_range, biases within bias_range"))
    add(Line("fastest", fastest, "FREVO moves nothing by more than 2; as a share of the range"))
    mapped.notes.append(
        "method.class = pso.PSO: another one; in FREVO the best place of a particle is always the "
        "one where it is, so that C1 pulls nothing, and fitness below 0 ends the run with an error"
    )
    if representation.class_name != MESHED:
        mapped.notes.append(
            f"method.class = pso.PSO: FREVO moves only {MESHED}; here {representation.class_name} moves, too"
        )


_MAPS: dict[str, Callable[[Session, Mapped], None]] = {
    NNGA: _map_nnga,
    CEA2D: _map_cea2d,
    PSO: _map_pso,
    RANDOM_SEARCH: _map_random_search,
}


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
