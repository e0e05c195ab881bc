"""Descriptions of simulations: built-in ones, and those named by a class in Python."""

import inspect
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import cache
from typing import TYPE_CHECKING, Any, Literal

from swarmwright import _engine
from swarmwright.common.errors import InputError, engine_errors
from swarmwright.common.groups import DeclaredGroup
from swarmwright.common.simulation_names import MISSIONS, is_command, is_python
from swarmwright.common.warn_once import warn_once
from swarmwright.simulations.parameters import ParameterMistake, filled_in, mistakes_in

if TYPE_CHECKING:
    from swarmwright.common.engine_types import Description
    from swarmwright.simulations.host import Host


ARENA = "arena"
"""The simulation whose missions other simulators can have."""


_ARENA_STEP = 0.1
"""Seconds of a step of the arena, `TICK` in engine/worlds/arena. Other built-in simulations have none."""


@cache
def titles() -> tuple[str, ...]:
    """Return the titles of the built-in simulations, sorted."""
    return tuple(_engine.simulations())


def built_in(simulation: str) -> str | None:
    """Return the built-in simulation whose parameters, sensors, actuators and metrics a simulation has.

    Its own title; `arena` for the arena's missions in another simulator, `arena-SIMULATOR`; None for others.
    """
    if simulation in titles():
        return simulation
    return ARENA if simulation.startswith(MISSIONS) else None


def has_missions(simulation: str) -> bool:
    """Whether a class in Python moves the robots of the arena's missions.

    Raises InputError when it cannot be loaded, or does not say what it has to.
    """
    from swarmwright.simulations.physics import Physics, check

    kind = _load(simulation)
    if not issubclass(kind, Physics):
        return False
    check(kind)
    return True


def _load(simulation: str) -> Any:  # noqa: ANN401 - a class, whose bases are imported when one is asked for
    from swarmwright.simulations.loading import load

    return load(simulation)


def _engine_title(simulation: str) -> str | None:
    """Return the title by which the engine knows a simulation; None for a class that describes itself.

    Raises InputError for a class that cannot be loaded.
    """
    if is_python(simulation):
        return ARENA if has_missions(simulation) else None
    return built_in(simulation) or simulation


def _python_description(name: str) -> Any:  # noqa: ANN401 - a Description, whose module is imported when one is asked for
    return _described(_load(name))  # the class may have changed when its file was edited


@cache
def _described(kind: Any) -> Any:  # noqa: ANN401 - as above
    from swarmwright.simulations.description import misspelt
    from swarmwright.simulations.host import Host

    found = Host(kind).description
    for text in misspelt(kind):
        warn_once(text)
    return found


def unmeasured(simulation: str) -> str | None:
    """Return why a class in Python cannot measure the metrics that it names; None where it can.

    Raises InputError for a class that cannot be loaded.
    """
    if not is_python(simulation) or is_command(simulation) or has_missions(simulation):
        return None
    from swarmwright.simulations.host import defines

    kind, metrics = _load(simulation), _python_description(simulation).metrics
    if not metrics or defines(kind, "measure"):
        return None
    return (
        f"{kind.__name__}.metrics names {', '.join(metrics)}, but the class has no method measure() that "
        "returns them; add it, or leave metrics out"
    )


def notice(simulation: str, parameters: Mapping[str, Any]) -> str | None:
    """Return what a class in Python has a user told before a run; None for nothing.

    Raises InputError for a class that cannot be loaded.
    """
    if not is_python(simulation) or is_command(simulation) or has_missions(simulation):
        return None
    told: str | None = _load(simulation).notice_before_run(parameters)
    return told


def is_described(simulation: str) -> bool:
    """Whether it is known here what a simulation offers, wherever it is run."""
    return built_in(simulation) is not None or is_python(simulation)


def is_here(simulation: str) -> bool:
    """Whether a simulation can be run by this machine: it is built in, or named by its class."""
    return simulation in titles() or is_python(simulation)


def playable(simulation: str) -> Any:  # noqa: ANN401 - as the engine takes it
    """Return what `_engine.Episode` takes: the title of a built-in simulation, or a host of a class.

    Raises InputError for a class that cannot be loaded.
    """
    if not is_python(simulation):
        return simulation
    from swarmwright.simulations.physics import hosted

    return hosted(_load(simulation))


def shown_as(simulation: str) -> Literal["scene", "picture"]:
    """Return what a simulation that is here can show: scenes, or pictures that it draws itself.

    Raises InputError for a class that cannot be loaded, or has nothing to show.
    """
    if not is_python(simulation) or has_missions(simulation):
        return "scene"
    from swarmwright.simulations.host import shown_as

    return shown_as(_load(simulation))


def drawing(simulation: str) -> "Host":
    """Return a host of a class that draws pictures. Raises InputError when it cannot."""
    from swarmwright.simulations.host import Host, drawing

    return Host(drawing(_load(simulation)))


def title(simulation: str) -> str:
    """Return the title of a simulation in discovery. Raises InputError for a class that cannot be loaded."""
    if not is_python(simulation):
        return simulation
    from swarmwright.simulations.physics import Physics, title_of

    kind = _load(simulation)
    return title_of(kind) if issubclass(kind, Physics) else str(_described(kind).title)


def description(simulation: str, parameters: dict[str, Any] | None = None) -> dict[str, Any]:
    """Return the description of a simulation that is known here, with default parameters or with these.

    Title, dimensions, max_agents, sensors, actuators, their names (sensor_names, actuator_names) and units
    (sensor_units, actuator_units; empty where the simulation has none), parameters, and metrics (name ->
    unit, description).
    Raises InputError for a class that cannot be loaded, and for parameters that the simulation refuses.
    """
    known = _engine_title(simulation)
    if known is None:
        plain: dict[str, Any] = _python_description(simulation).plain()
        return plain
    announced = _announced(known)
    if announced["varies"] and parameters:
        with engine_errors():
            announced = _engine.describe(known, parameters)
    return {**announced, "title": title(simulation)}


def ranges(
    simulation: str, parameters: dict[str, Any], group: str | None = None
) -> dict[str, list[list[Any] | None]]:
    """Return what -1 and 1 of sensors and actuators stand for, where a simulation scales them.

    `sensor_ranges` and `actuator_ranges`, one [low, high, unit] or None for each, of the agents of a group
    where it is named; nothing for a simulation that has no ranges. Those of an environment of another library
    may depend on parameters, and it is made with these.
    Raises InputError for a class that cannot be loaded, and for parameters that an environment refuses.
    """
    return ranges_by_group(simulation, parameters, [group])[group]


def ranges_by_group(
    simulation: str, parameters: dict[str, Any], names: Iterable[str | None]
) -> dict[str | None, dict[str, list[list[Any] | None]]]:
    """Return the ranges of several groups, None for all agents; see `ranges`.

    An environment is made once for all of them.
    """
    if _engine_title(simulation) is not None:
        return {name: {} for name in names}
    found = _description_with(simulation, parameters)
    return {name: _ranges(found if name is None else found.groups[name]) for name in names}


def _description_with(simulation: str, parameters: dict[str, Any]) -> Any:  # noqa: ANN401 - as above
    kind = _load(simulation)
    given = {name: value for name, value in parameters.items() if name != "seed"}
    if not given or not hasattr(kind, "described_with"):
        return _described(kind)
    from swarmwright.simulations.description import describe

    made_with = kind()
    try:
        return describe(made_with.described_with(given), kind.__name__)
    finally:
        with suppress(Exception):  # what it announces counts also where it cannot be closed
            made_with.env.close()


def construction_problem(simulation: str, parameters: dict[str, Any]) -> str | None:
    """Return why an environment of another library cannot be made with these parameters.

    None where it can, and for other simulations, whose parameters are checked by their declarations. Raises
    InputError for a class that cannot be loaded.
    """
    if _engine_title(simulation) is not None or not hasattr(_load(simulation), "described_with"):
        return None
    try:
        _description_with(simulation, parameters)
    except InputError as error:
        if "unexpected keyword argument" not in str(error):
            return str(error)
        made = _load(simulation)()
        with suppress(Exception):  # the names help, and are not needed
            names = _constructor_names(made.env)
            made.env.close()
            return f"{error}; its constructor takes {', '.join(names) or 'no parameters'}"
        return str(error)
    return None


def _constructor_names(env: Any) -> list[str]:  # noqa: ANN401 - types of libraries
    """Return the names that the constructor of an environment takes. Raises any exception where none says."""
    _, *parameters = inspect.signature(type(env.unwrapped).__init__).parameters.values()
    if any(parameter.kind in {parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL} for parameter in parameters):
        raise ValueError("it takes any")
    return [parameter.name for parameter in parameters if parameter.name != "render_mode"]


def _ranges(of: Any) -> dict[str, list[list[Any] | None]]:  # noqa: ANN401 - a Description or a Group
    from swarmwright.common.ranges import ranges_of

    made = {}
    for which in ("sensor", "actuator"):
        named = ranges_of(getattr(of, f"{which}_ranges"), getattr(of, f"{which}s"))
        if any(named):
            made[f"{which}_ranges"] = [None if ends is None else list(ends) for ends in named]
    return made


def step_seconds(simulation: str) -> float | None:
    """Return the seconds of a step in the world that is simulated; None where they are not known.

    They are not the time for which a step is shown. Raises InputError for a class that cannot be loaded.
    """
    known = _engine_title(simulation)
    if known is None:
        seconds: float | None = _python_description(simulation).step_seconds
        return seconds
    return _ARENA_STEP if known == ARENA else None


def channels(simulation: str, parameters: dict[str, Any]) -> dict[str, Any]:
    """Return what exported controllers say of a simulation that is known here; a store keeps it as JSON.

    `sensor_names`, `sensor_units` and `sensor_ranges` (see `ranges`), the same of actuators, `step_seconds`,
    and `groups`, where agents differ: for each by name, its names and ranges.
    Raises InputError as `description` and `ranges` do.
    """
    described = description(simulation, parameters)
    named = {
        f"{which}_{about}": list(described[f"{which}_{about}"])
        for which in ("sensor", "actuator")
        for about in ("names", "units")
    }
    kinds = groups(simulation, parameters)
    of_ranges = ranges_by_group(simulation, parameters, [kind.name for kind in kinds] or [None])
    of_groups = {
        kind.name: {
            "sensor_names": list(kind.sensor_names),
            "actuator_names": list(kind.actuator_names),
            **of_ranges[kind.name],
        }
        for kind in kinds
    }
    found = {**named, **of_ranges.get(None, {})}
    return {**found, "step_seconds": step_seconds(simulation), "groups": of_groups}


@cache
def _announced(title: str) -> "Description":
    with engine_errors():
        return _engine.describe(title)


def groups(simulation: str, parameters: dict[str, Any]) -> list[DeclaredGroup]:
    """Return the kinds of agents of a simulation that is known here, with these parameters.

    Empty where all agents are alike. Raises InputError for a class that cannot be loaded, and for parameters
    that the simulation refuses.
    """
    known = _engine_title(simulation)
    if known is None:
        from swarmwright.simulations.base import counted

        found = _python_description(simulation)
        if not found.groups:
            return []
        return counted(found.groups, filled_in(found.parameters, parameters))
    with engine_errors():
        announced = _engine.describe(known, parameters)["groups"]
    return [
        DeclaredGroup(
            group["name"],
            group["agents"],
            group["sensors"],
            group["actuators"],
            tuple(group["sensor_names"]),
            tuple(group["actuator_names"]),
            tuple(group["own_sensor_names"]),
            tuple(group["own_actuator_names"]),
        )
        for group in announced
    ]


def parameter_names(simulation: str) -> list[str]:
    """Return the names of the parameters of a simulation that is here, the seed among them."""
    return list(dict.fromkeys([*description(simulation)["parameters"], "seed"]))


def declares_boolean(simulation: str, name: str) -> bool:
    """Return whether a parameter is one of a class in Python, which gets True or False for it.

    Raises InputError when the class cannot be loaded.
    """
    if _engine_title(simulation) is not None:
        return False
    known = _python_description(simulation).parameters
    return name in known and bool(known[name].kind == "boolean")


def takes_any(simulation: str) -> bool:
    """Return whether any other parameter is possible, too: in a class that declares none."""
    return is_python(simulation) and not description(simulation)["parameters"]


def steers_itself(simulation: str, parameters: dict[str, Any]) -> bool:
    """Return whether the agents of a simulation that is here steer themselves with these parameters.

    So do those of a class whose episodes end at their start, which computes everything in `reset`.
    Raises InputError for parameters that the simulation refuses.
    """
    with engine_errors():
        known = _engine_title(simulation)
        if known is None:
            from swarmwright.simulations.host import Host

            host = Host(_load(simulation))
            if host.steers_itself is not None:
                return bool(host.steers_itself)
            acting, _, done = host.reset(parameters)
            return done or not len(acting)
        return _engine.steers_itself(known, parameters)


def parameter_mistakes(simulation: str, parameters: dict[str, Any]) -> list[ParameterMistake]:
    """Return all that is wrong with the parameters of a simulation that is here.

    Raises InputError for a class that cannot be loaded, and for values that cannot be sent as JSON.
    """
    known = _engine_title(simulation)
    if known is None:
        return list(mistakes_in(_python_description(simulation).parameters, parameters))
    with engine_errors():
        return [ParameterMistake(*mistake) for mistake in _engine.parameter_mistakes(known, parameters)]
