"""Descriptions of simulations: built-in ones, and those named by a class in Python."""

import inspect
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import cache
from typing import TYPE_CHECKING, Any, Literal

from swarmwright import _engine
from swarmwright.common.errors import InputError, engine_errors
from swarmwright.common.groups import DeclaredGroup, DeclaredSide
from swarmwright.common.simulation_names import MISSIONS, is_command, is_python
from swarmwright.common.warn_once import warn_once
from swarmwright.simulations.parameters import Parameter, ParameterMistake, fill_parameters, find_mistakes

if TYPE_CHECKING:
    from swarmwright.common.engine_types import Description
    from swarmwright.simulations.host import Host


ARENA = "arena"
"""The simulation whose missions other simulators can run."""


_ARENA_STEP = 0.1
"""Seconds of a step of the arena, `TICK` in engine/worlds/arena. Other built-in simulations have no time."""


@cache
def titles() -> tuple[str, ...]:
    """Return the titles of the built-in simulations, sorted."""
    return tuple(_engine.simulations())


def find_built_in(simulation: str) -> str | None:
    """Return the built-in simulation whose parameters, sensors, actuators and metrics a simulation has.

    That is its own title for a built-in simulation; `arena` for a simulator that runs the arena's missions,
    `arena-SIMULATOR`; None for other simulations.
    """
    if simulation in titles():
        return simulation
    return ARENA if simulation.startswith(MISSIONS) else None


def has_missions(simulation: str) -> bool:
    """Return whether a class in Python moves the robots of the arena's missions.

    Raises InputError if it cannot be loaded, or its attributes are not valid.
    """
    from swarmwright.simulations.physics import Physics, check

    kind = _load(simulation)
    if not issubclass(kind, Physics):
        return False
    check(kind)
    return True


def _load(simulation: str) -> Any:  # noqa: ANN401 - a class, whose bases are imported lazily
    from swarmwright.simulations.loading import load

    return load(simulation)


def _engine_title(simulation: str) -> str | None:
    """Return the engine's title of a simulation; None for a class that describes itself.

    Raises InputError for a class that cannot be loaded.
    """
    if is_python(simulation):
        return ARENA if has_missions(simulation) else None
    return find_built_in(simulation) or simulation


def _python_description(name: str) -> Any:  # noqa: ANN401 - a Description, whose module is imported lazily
    return _describe_class(_load(name))  # the class may have changed when its file was edited


@cache
def _describe_class(kind: Any) -> Any:  # noqa: ANN401 - as above
    from swarmwright.simulations.host import Host, find_misspelt_attributes

    description = Host(kind).description
    for text in find_misspelt_attributes(kind):
        warn_once(text)
    return description


def explain_missing_measure(simulation: str) -> str | None:
    """Return why a class in Python cannot measure the metrics that it declares; None if it can.

    Raises InputError for a class that cannot be loaded.
    """
    if not is_python(simulation) or is_command(simulation) or has_missions(simulation):
        return None
    from swarmwright.simulations.host import overrides

    kind, metrics = _load(simulation), _python_description(simulation).metrics
    if not metrics or overrides(kind, "measure"):
        return None
    return (
        f"{kind.__name__}.metrics declares {', '.join(metrics)}, but the class has no method measure() that "
        "returns them; add the method, or remove metrics"
    )


def get_notice(simulation: str, parameters: Mapping[str, Any]) -> str | None:
    """Return the notice that a class in Python has for the user before a run; None without one.

    Raises InputError for a class that cannot be loaded.
    """
    if not is_python(simulation) or is_command(simulation) or has_missions(simulation):
        return None
    text: str | None = _load(simulation).notice_before_run(parameters)
    return text


def has_description(simulation: str) -> bool:
    """Return whether this machine has the description of a simulation, wherever it runs."""
    return find_built_in(simulation) is not None or is_python(simulation)


def is_local(simulation: str) -> bool:
    """Return whether this machine can run a simulation: it is built in, or named by its class."""
    return simulation in titles() or is_python(simulation)


def make_playable(simulation: str) -> Any:  # noqa: ANN401 - as the engine takes it
    """Return the argument of `_engine.Episode`: the title of a built-in simulation, or a host of a class.

    Raises InputError for a class that cannot be loaded.
    """
    if not is_python(simulation):
        return simulation
    from swarmwright.simulations.physics import make_host

    return make_host(_load(simulation))


def choose_display(simulation: str) -> Literal["scene", "picture"]:
    """Return what a local simulation can display: scenes, or pictures that it draws itself.

    Raises InputError for a class that cannot be loaded, or has nothing to display.
    """
    if not is_python(simulation) or has_missions(simulation):
        return "scene"
    from swarmwright.simulations.host import choose_display

    return choose_display(_load(simulation))


def make_drawing_host(simulation: str) -> "Host":
    """Return a host of a class that draws pictures. Raises InputError if it cannot."""
    from swarmwright.simulations.host import Host, make_drawing_class

    return Host(make_drawing_class(_load(simulation)))


def title(simulation: str) -> str:
    """Return the title of a simulation in discovery. Raises InputError for a class that cannot be loaded."""
    if not is_python(simulation):
        return simulation
    from swarmwright.simulations.physics import Physics, get_title

    kind = _load(simulation)
    return get_title(kind) if issubclass(kind, Physics) else str(_describe_class(kind).title)


def description(simulation: str, parameters: dict[str, Any] | None = None) -> dict[str, Any]:
    """Return the description of a local simulation with these parameters, or its defaults.

    Title, dimensions, max_agents, sensors, actuators, their names (sensor_names, actuator_names) and units
    (sensor_units, actuator_units; empty if the simulation has none), parameters, and metrics (name -> unit,
    description).
    Raises InputError for a class that cannot be loaded, and for parameters that the simulation refuses.
    """
    engine_title = _engine_title(simulation)
    if engine_title is None:
        plain: dict[str, Any] = _python_description(simulation).plain()
        return plain
    announced = _describe_built_in(engine_title)
    if announced["varies"] and parameters:
        with engine_errors():
            announced = _engine.describe(engine_title, parameters)
    return {**announced, "title": title(simulation)}


def ranges(
    simulation: str, parameters: dict[str, Any], group: str | None = None
) -> dict[str, list[list[Any] | None]]:
    """Return the values that -1 and 1 of scaled sensors and actuators stand for.

    `sensor_ranges` and `actuator_ranges`: [low, high, unit] or None for each, of all agents or of a group;
    empty for a simulation without ranges. An environment of another library is created with the parameters,
    on which its ranges may depend.
    Raises InputError for a class that cannot be loaded, and for parameters that an environment refuses.
    """
    return ranges_by_group(simulation, parameters, [group])[group]


def ranges_by_group(
    simulation: str, parameters: dict[str, Any], names: Iterable[str | None]
) -> dict[str | None, dict[str, list[list[Any] | None]]]:
    """Return the ranges of several groups, None for all agents, creating an environment once.

    See `ranges`.
    """
    if _engine_title(simulation) is not None:
        return {name: {} for name in names}
    description = _description_with(simulation, parameters)
    return {name: _ranges(description if name is None else description.groups[name]) for name in names}


def _description_with(simulation: str, parameters: dict[str, Any]) -> Any:  # noqa: ANN401 - as above
    kind = _load(simulation)
    given_parameters = {name: value for name, value in parameters.items() if name != "seed"}
    if not given_parameters or not hasattr(kind, "configure"):
        return _describe_class(kind)
    from swarmwright.simulations.host import describe

    made_with = kind()
    try:
        return describe(made_with.configure(given_parameters), kind.__name__)
    finally:
        with suppress(Exception):  # the description is valid even if closing fails
            made_with.env.close()


def construction_problem(simulation: str, parameters: dict[str, Any]) -> str | None:
    """Return why an environment of another library cannot be created with these parameters.

    None if it can, and for other simulations, whose declarations are checked instead. Raises InputError for a
    class that cannot be loaded.
    """
    if _engine_title(simulation) is not None or not hasattr(_load(simulation), "configure"):
        return None
    try:
        _description_with(simulation, parameters)
    except InputError as error:
        if "unexpected keyword argument" not in str(error):
            return str(error)
        environment = _load(simulation)()
        with suppress(Exception):  # the names are optional
            names = _constructor_names(environment.env)
            environment.env.close()
            return f"{error}; its constructor takes {', '.join(names) or 'no parameters'}"
        return str(error)
    return None


def _constructor_names(env: Any) -> list[str]:  # noqa: ANN401 - types of libraries
    """Return the parameter names of an environment's constructor. May raise any exception."""
    _, *parameters = inspect.signature(type(env.unwrapped).__init__).parameters.values()
    if any(parameter.kind in {parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL} for parameter in parameters):
        raise ValueError("it takes any")
    return [parameter.name for parameter in parameters if parameter.name != "render_mode"]


def _ranges(described: Any) -> dict[str, list[list[Any] | None]]:  # noqa: ANN401 - a Description or a Group
    from swarmwright.common.ranges import ranges_of

    ranges = {}
    for kind in ("sensor", "actuator"):
        limits = ranges_of(getattr(described, f"{kind}_ranges"), getattr(described, f"{kind}s"))
        if any(limits):
            ranges[f"{kind}_ranges"] = [None if ends is None else list(ends) for ends in limits]
    return ranges


def step_seconds(simulation: str) -> float | None:
    """Return the simulated seconds of a step; None if unknown.

    This is not the time between displayed frames. Raises InputError for a class that cannot be loaded.
    """
    engine_title = _engine_title(simulation)
    if engine_title is None:
        seconds: float | None = _python_description(simulation).step_seconds
        return seconds
    return _ARENA_STEP if engine_title == ARENA else None


def channels(simulation: str, parameters: dict[str, Any]) -> dict[str, Any]:
    """Return the properties of a local simulation for exported controllers; a store keeps them as JSON.

    `sensor_names`, `sensor_units` and `sensor_ranges` (see `ranges`), the same for actuators, `step_seconds`,
    and `groups`: for each group, if agents differ, its names and ranges.
    Raises InputError like `description` and `ranges`.
    """
    described = description(simulation, parameters)
    named = {
        f"{kind}_{about}": list(described[f"{kind}_{about}"])
        for kind in ("sensor", "actuator")
        for about in ("names", "units")
    }
    kinds = groups(simulation, parameters)
    group_ranges = ranges_by_group(simulation, parameters, [kind.name for kind in kinds] or [None])
    group_channels = {
        kind.name: {
            "sensor_names": list(kind.sensor_names),
            "actuator_names": list(kind.actuator_names),
            **group_ranges[kind.name],
        }
        for kind in kinds
    }
    names_and_ranges = {**named, **group_ranges.get(None, {})}
    return {**names_and_ranges, "step_seconds": step_seconds(simulation), "groups": group_channels}


@cache
def _describe_built_in(title: str) -> "Description":
    with engine_errors():
        return _engine.describe(title)


def groups(simulation: str, parameters: dict[str, Any]) -> list[DeclaredGroup]:
    """Return the kinds of agents of a local simulation with these parameters.

    Empty if all agents are alike. Raises InputError for a class that cannot be loaded, and for parameters
    that the simulation refuses.
    """
    engine_title = _engine_title(simulation)
    if engine_title is None:
        from swarmwright.simulations.base import count_groups

        described = _python_description(simulation)
        if not described.groups:
            return []
        return count_groups(described.groups, fill_parameters(described.parameters, parameters))
    with engine_errors():
        announced = _engine.describe(engine_title, parameters)["groups"]
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


def sides(simulation: str, parameters: dict[str, Any]) -> list[DeclaredSide]:
    """Return the sides of a match of a local simulation with these parameters.

    If it declares none, each of several groups is a side, without a fitness; empty if all agents are alike.
    Raises InputError for a class that cannot be loaded, and for parameters that the simulation refuses.
    """
    engine_title = _engine_title(simulation)
    if engine_title is None:
        return list(_python_description(simulation).sides)
    with engine_errors():
        announced = _engine.describe(engine_title, parameters)
    if announced["sides"]:
        return [
            DeclaredSide(side["name"], tuple(side["groups"]), side["fitness"]) for side in announced["sides"]
        ]
    return [DeclaredSide(group["name"], (group["name"],)) for group in announced["groups"]]


def parameter_names(simulation: str) -> list[str]:
    """Return the names of the parameters of a local simulation, including the seed."""
    return list(dict.fromkeys([*description(simulation)["parameters"], "seed"]))


def list_parameters(simulation: str) -> Mapping[str, Parameter]:
    """Return the parameters of a local simulation, without the seed.

    Built-in simulations declare no limits and no choices, only defaults. Raises InputError for a class that
    cannot be loaded.
    """
    if _engine_title(simulation) is None:
        declared: Mapping[str, Parameter] = _python_description(simulation).parameters
        return declared
    return {
        name: Parameter(parameter["default"], parameter["description"])
        for name, parameter in description(simulation)["parameters"].items()
        if name != "seed"
    }


def mission_names() -> list[str]:
    """Return the names of the arena's built-in missions."""
    return [mission["name"] for mission in _engine.missions()]


def declares_boolean(simulation: str, name: str) -> bool:
    """Return whether a class in Python declares a parameter as a boolean.

    Raises InputError if the class cannot be loaded.
    """
    if _engine_title(simulation) is not None:
        return False
    declarations = _python_description(simulation).parameters
    return name in declarations and bool(declarations[name].kind == "boolean")


def takes_any(simulation: str) -> bool:
    """Return whether a simulation takes any parameters: a class that declares none."""
    return is_python(simulation) and not description(simulation)["parameters"]


def steers_itself(simulation: str, parameters: dict[str, Any]) -> bool:
    """Return whether the agents of a local simulation steer themselves with these parameters.

    This includes a class that computes the whole episode in `reset`. Raises InputError for parameters that
    the simulation refuses.
    """
    with engine_errors():
        engine_title = _engine_title(simulation)
        if engine_title is None:
            from swarmwright.simulations.host import Host

            host = Host(_load(simulation))
            if host.steers_itself is not None:
                return bool(host.steers_itself)
            acting, _, done = host.reset(parameters)
            return done or not len(acting)
        return _engine.steers_itself(engine_title, parameters)


def parameter_mistakes(simulation: str, parameters: dict[str, Any]) -> list[ParameterMistake]:
    """Return all mistakes in the parameters of a local simulation.

    Raises InputError for a class that cannot be loaded, and for values that cannot be sent as JSON.
    """
    engine_title = _engine_title(simulation)
    if engine_title is None:
        return list(find_mistakes(_python_description(simulation).parameters, parameters))
    with engine_errors():
        return [
            ParameterMistake(*mistake) for mistake in _engine.parameter_mistakes(engine_title, parameters)
        ]
