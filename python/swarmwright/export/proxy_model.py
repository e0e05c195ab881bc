"""The FMU of a simulation server: a proxy with the variables of the server's simulation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from swarmwright import _engine
from swarmwright.common.errors import InputError, engine_errors
from swarmwright.common.groups import DeclaredGroup
from swarmwright.experiment.derived import place_of
from swarmwright.experiment.experiment import Experiment
from swarmwright.export.simulation_model import (
    Model,
    Parameter,
    check_size,
    collect_parameters,
    measure_start,
)
from swarmwright.simulations import catalogue

CONNECTION = "connection."
"""Prefix of the parameters of the connection, as in `engine/bindings/fmi`."""
_ANNOUNCEMENT_WAIT_S = 1.0
_AGENTS = ("numAgents", "robots", "agents")
"""Parameters that may hold the number of agents."""


@dataclass(frozen=True)
class Address:
    """Default connection of a proxy to its server."""

    broker: str
    """URL, or the URLs of a cluster, separated by commas."""
    prefix: str = ""
    server: int | None = None
    """Id of the server to use; None for any."""
    discovery_s: float = 10.0
    """Seconds to search for a free server."""
    step_s: float = 60.0
    """Seconds that a server may take for a step."""


def proxy_model(experiment: Experiment, address: Address, agents: int | None = None) -> Model:
    """Return the model of a simulation offered by servers.

    Its variables are known if the simulation is available on this machine, or from a server that announces it
    on the broker; otherwise from the experiment.

    Args:
        experiment: its simulation, parameters, sensors, actuators and requirements.
        address: address of the servers.
        agents: number of agents with variables; default: derived.

    Raises:
        InputError: sensors, actuators or agents are unknown, or parameters are invalid.

    """
    simulation, parameters = experiment.simulation, experiment.parameters
    base = {name: value for name, value in parameters.items() if name != "seed"}
    seed = int(parameters.get("seed", 0)) % 2**64
    period = 1.0
    groups: Sequence[DeclaredGroup] = ()
    ranges: dict[str | None, Mapping[str, Any]] = {}
    if catalogue.has_description(simulation):
        groups = catalogue.groups(simulation, dict(parameters))
        description: Mapping[str, Any] = catalogue.description(simulation, dict(parameters))
        limited = catalogue.find_built_in(simulation) is not None
        simulation_parameters = collect_parameters(description, base, have_limits=limited)
        names: list[str | None] = [group.name for group in groups]
        ranges.update(catalogue.ranges_by_group(simulation, dict(parameters), names or [None]))
    else:
        description = _find_description(experiment, address)
        declared = {"parameters": {name: _declaration_of_value(value) for name, value in base.items()}}
        simulation_parameters = collect_parameters(declared, base, have_limits=False)
    if catalogue.is_local(simulation) and description["actuators"]:
        agent_count, _, period = measure_start(
            catalogue.make_playable(simulation),
            base,
            seed,
            int(description["actuators"]),
            catalogue.step_seconds(simulation),
        )
        agents = agent_count if agents is None else agents
    if agents is None:
        agents = _agents(experiment, description)
    check_size(simulation, agents, description)
    return Model(
        catalogue.title(simulation),
        description,
        base,
        seed,
        agents,
        period,
        parameters=[*_connection(catalogue.title(simulation), address), *simulation_parameters],
        dimensions=experiment.requirements.dimensions,
        groups=groups,
        ranges=ranges,
    )


def _find_description(experiment: Experiment, address: Address) -> dict[str, Any]:
    """Return a description from the experiment and, if it is incomplete, from a server."""
    title, announced = experiment.simulation, {}
    if experiment.sensors is None or experiment.actuators is None:
        try:
            with engine_errors():
                servers = _engine.servers(address.broker, prefix=address.prefix, wait=_ANNOUNCEMENT_WAIT_S)
        except _engine.NoBrokerError as error:
            raise InputError(f"{_unknown(experiment)}, and servers cannot be reached: {error}") from None
        for server in servers:
            if title in server["simulations"] and address.server in (None, server["server"]):
                announced = server["capabilities"].get("swarmwright", {})
                break
    numbers = {
        name: announced.get(name) if number is None else number
        for name, number in (("sensors", experiment.sensors), ("actuators", experiment.actuators))
    }
    for name, number in numbers.items():
        if number is None:
            raise InputError(
                f"{_unknown(experiment, name)}, and no server on {address.broker} announces them; set "
                "'sensors' and 'actuators' in an experiment file, or with --set sensors=N --set actuators=N"
            )
    metrics = {name: {"unit": "", "description": ""} for name in announced.get("metrics", [])}
    return {**numbers, "sensor_names": [], "actuator_names": [], "sensor_units": [], "actuator_units": [],
            "metrics": metrics, "max_agents": None}  # fmt: skip


def _unknown(experiment: Experiment, name: str = "sensors") -> str:
    return (
        f"{place_of(experiment, 'simulation')}the number of {name} is unknown, because "
        f"{experiment.simulation!r} is not built in"
    )


def _declaration_of_value(value: Any) -> dict[str, Any]:  # noqa: ANN401 - any value of a file
    """Return the declaration of a parameter whose value is known."""
    kinds = {bool: "boolean", int: "integer", float: "number", str: "string"}
    return {"type": kinds.get(type(value), "object"), "default": value, "description": "Of the simulation."}


def _agents(experiment: Experiment, description: Mapping[str, Any]) -> int:
    for name in _AGENTS:
        value = experiment.parameters.get(name)
        if isinstance(value, int) and not isinstance(value, bool) and value > 0:
            return value
    most = experiment.requirements.max_agents or description.get("max_agents")
    if most is None:
        raise InputError(
            f"the number of agents of {experiment.simulation!r} is unknown; set it with --agents"
        )
    return int(most)


def _connection(title: str, address: Address) -> list[Parameter]:
    """Return the parameters of the connection."""
    texts = {
        "broker": (address.broker, ("URL of the broker: mqtt://, mqtts://, ws:// or wss://HOST:PORT, or "
                   "unix:///PATH; several of a cluster, separated by commas.")),
        "prefix": (address.prefix, "Prefix of all topics; empty for none."),
        "username": ("", "Account at the broker; empty: SWARMWRIGHT_USERNAME of the environment."),
        "passwordFile": ("", ("File whose first line is the password; empty: SWARMWRIGHT_PASSWORD or "
                         "SWARMWRIGHT_PASSWORD_FILE of the environment.")),
        "caFile": ("", ("Certificate authority, PEM, for mqtts and wss; empty: SWARMWRIGHT_CA_FILE of the "
                   "environment, or the system's. A client certificate is taken from the environment alone: "
                   "SWARMWRIGHT_CERTIFICATE_FILE and SWARMWRIGHT_KEY_FILE.")),
        "simulation": (title, "Title of the simulation, by which servers are found."),
    }  # fmt: skip
    seconds = {
        "discoveryTimeout": (address.discovery_s, "Seconds for which a free server is looked for."),
        "stepTimeout": (address.step_s, "Seconds that a server may take for a step."),
        "gatherTime": (0.1, ("Seconds for which further agents of a step are waited for, where the server "
                       "implements D6.1 alone and not all agents of the last step have answered.")),
    }  # fmt: skip
    server = -1 if address.server is None else address.server
    return [
        *(Parameter(f"{CONNECTION}{name}", "text", *about) for name, about in texts.items()),
        Parameter(f"{CONNECTION}server", "integer", server, "Id of the only server to be used; -1 for any."),
        *(Parameter(f"{CONNECTION}{name}", "number", *about, unit="s") for name, about in seconds.items()),
    ]
