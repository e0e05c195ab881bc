"""Evolved controllers, callable on numpy arrays."""

import json
from collections.abc import Mapping, Sequence
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmwright import _engine
from swarmwright.common.arguments import check_arguments, mapping, path_of
from swarmwright.common.arrays import float32_of
from swarmwright.common.errors import InputError, describe_exception, engine_errors
from swarmwright.common.files import read_bytes, write_text
from swarmwright.common.json_text import loads
from swarmwright.common.problems import format_value
from swarmwright.controllers.kinds import kind_of
from swarmwright.controllers.modules.grammar import ACTUATORS, PYTHON_KIND, SENSORS
from swarmwright.controllers.modules.machine import Swarm
from swarmwright.controllers.modules.registered import import_modules
from swarmwright.controllers.teams import is_team, parts_of

_LARGEST_FILE_BYTES = 1 << 28
"""Size limit of controller files, in bytes."""


class Controller:
    """A callable that maps sensor values to actuators, for one agent or a swarm; or simulation parameters.

    Call it with an array of shape (sensors,) for one agent or (agents, sensors) for a swarm; it returns
    float32 of shape (actuators,) or (agents, actuators), each number in -1..1, bit-identical to the
    results of every simulation server. Each agent (row) keeps its state between calls if the representation
    has a state; `reset` begins a new episode. Several episodes at once, and agents that end before others,
    need a state for each agent of each episode: `Episodes.run(controller)` keeps these states; elsewhere, use
    a copy (`copy.copy`) for each agent. In a team, rows belong to its groups of agents in their order; values
    beyond the sensors of the agent's group are ignored, and those beyond its actuators are 0. A parameter set
    steers no agents: it has `parameters` and cannot be called. Controllers can be pickled and copied; a copy
    is at the start of an episode.

    Args:
        specification: mapping or JSON text, see protocol/schemas/controller.schema.json.

    Raises:
        InputError: the specification is wrong; the message names the field.
    """

    def __init__(self, specification: Mapping[str, Any] | str) -> None:
        if isinstance(specification, str):
            if not specification.lstrip().startswith("{"):
                raise InputError(
                    f"controller: must be a mapping or JSON text, not {format_value(specification)}; "
                    "Controller.load(path) reads a file or a run folder"
                )
            self._text = specification
        else:
            mapping("controller", specification, "Controller.load(path) to read a file")
            try:
                self._text = json.dumps(dict(specification), allow_nan=False)
            except (TypeError, ValueError, RecursionError) as error:
                raise InputError(f"controller: cannot be written as JSON: {error}") from error
        self._swarm = self._python_swarm()
        self._whole: _engine.Controller | None = None  # parsed by the engine, at the start of an episode
        if self._swarm is None:
            with engine_errors("controller: "):
                self._whole = _engine.Controller(self._text)
        self._agents: list[_engine.Controller] = []
        self._started = 0

    def _python_swarm(self) -> Swarm | None:
        """Return the stepper of a machine with modules in Python; None if the engine steps the controller."""
        if f'"{PYTHON_KIND}"' not in self._text:
            return None
        try:
            values = json.loads(self._text)
            if not isinstance(values, dict) or values.get("kind") != PYTHON_KIND:
                return None
            return Swarm(values, np.array([values["weights"]], dtype=np.float32))
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            raise InputError(
                f"controller: invalid machine of modules: {describe_exception(error)}"
            ) from error

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Self:
        """Read a controller: a specification (JSON), a run's `best.json`, or a run folder.

        A machine or tree of the built-in behaviours and conditions may be in YAML, as written by `swarmwright
        export --to machine`. Raises InputError when the file is not a controller.
        """
        file = path_of("path", path, "a controller or a run folder")
        if file.is_dir():
            file /= "best.json"
        if file.suffix in {".yaml", ".yml"}:
            from swarmwright.controllers.kinds.modules.representation import read_specification

            return cls(read_specification(file))
        values = _read(file)
        if isinstance(values, dict) and isinstance(values.get("controller"), dict):
            values = values["controller"]
        if not isinstance(values, dict):
            raise InputError(
                f"{file}: is not a controller; expected a JSON object with version, kind, weights, .."
            )
        try:
            if values.get("kind") == PYTHON_KIND:
                _import_modules(values, file.parent)
            return cls(values)
        except InputError as error:
            raise InputError(f"{file}: {error}") from error

    @check_arguments
    def save(self, path: str | PathLike[str]) -> None:
        """Write the specification as JSON. Raises InputError when the file cannot be written."""
        write_text(path, json.dumps(self.specification, indent=2) + "\n")

    @property
    def specification(self) -> dict[str, Any]:
        """The specification as plain values."""
        values: dict[str, Any] = json.loads(self._text)
        return values

    @property
    def json(self) -> str:
        """The specification as JSON text."""
        return self._text

    @property
    def parameters(self) -> dict[str, Any]:
        """Values of a parameter set by name, as the simulation gets them; {} for other controllers."""
        return {} if self._whole is None or self._is_team else self._whole.parameters

    @property
    def sensors(self) -> int:
        """Number of sensor values of an agent; 0 for a parameter set."""
        return SENSORS if self._whole is None else self._whole.sensors

    @property
    def actuators(self) -> int:
        """Number of actuator values of an agent; 0 for a parameter set."""
        return ACTUATORS if self._whole is None else self._whole.actuators

    @cached_property
    def _is_stateless(self) -> bool:
        """Whether the actuators of every agent are the same function of its sensors in the same step."""
        return self._swarm is None and kind_of(self.specification).stateless

    def reset(self) -> None:
        """Begin a new episode: discard all agents and their state."""
        self._agents = []
        self._started = 0

    def __call__(self, sensors: ArrayLike) -> NDArray[np.float32]:
        """Return the actuators for the sensors of one agent or of a swarm, see the class.

        Raises InputError for another shape, a number that is not finite, a parameter set, and, if agents have
        a state or differ, another number of agents than in the previous call: rows would take over each
        other's state.
        """
        if not self.sensors:
            raise InputError(
                "controller: a parameter set steers no agents and cannot be called; read its "
                "`parameters`, or use `simulate`"
            )
        values = float32_of("sensors", sensors)
        if values.ndim not in {1, 2} or values.shape[-1] != self.sensors:
            raise InputError(
                f"sensors: have the shape {values.shape}; expected ({self.sensors},) for one agent "
                f"or (agents, {self.sensors}) for a swarm"
            )
        rows = np.ascontiguousarray(np.atleast_2d(values))
        if not np.isfinite(rows).all():
            raise InputError("sensors: hold a number that is not finite")
        if not len(rows):  # no agent acts now
            return np.zeros((0, self.actuators), dtype=np.float32)
        if self._swarm is not None:
            return self._step_swarm(self._swarm, rows, whole=values.ndim == 2)
        assert self._whole is not None
        if self._is_stateless:
            agents = [self._whole] * len(rows)
        else:
            self._check_agents(len(rows))
            if not self._started:
                with engine_errors("controller: "):
                    self._agents = [self._whole.of_agent(agent) for agent in range(len(rows))]
            self._started = len(rows)
            agents = self._agents
        actuators = _step_agents(agents, rows, self.actuators)
        return actuators if values.ndim == 2 else actuators[0]

    def _step_swarm(self, swarm: Swarm, rows: NDArray[np.float32], *, whole: bool) -> NDArray[np.float32]:
        self._check_agents(len(rows))
        if not self._started:
            swarm.restart(np.zeros(len(rows), dtype=np.int64))
        self._started = len(rows)
        actuators = swarm.step(np.arange(len(rows)), rows)
        return actuators if whole else actuators[0]

    def _check_agents(self, agents: int) -> None:
        if self._started not in {0, agents}:
            raise InputError(
                f"sensors: {agents} agent(s) now, {self._started} before, but each row keeps the state of "
                "its agent. Call reset() to begin a new episode; if agents end at different steps, use "
                "Episodes.run(controller) or a copy of the controller (copy.copy) for each agent"
            )

    @cached_property
    def groups(self) -> dict[str, "Controller"]:
        """The controller of each group of a team, by name; empty for others."""
        return {name: Controller(part) for name, part in parts_of(self.specification).items()}

    @cached_property
    def _is_team(self) -> bool:
        return self._swarm is None and is_team(self.specification)

    def _repr_html_(self) -> str:
        """Return the kind, the sizes and a drawing, for notebooks."""
        from swarmwright.common.html import facts, picture, png_of
        from swarmwright.controllers.figures import figure

        values = self.specification
        rows: list[tuple[str, object]] = [
            (name, values[name])
            for name in ("kind", "sensors", "hidden", "actuators", "activation", "output_activation")
            if name in values
        ]
        rows += self.parameters.items()
        drawing = png_of(figure(values, title=str(values.get("kind", "controller"))))
        return facts("Controller", rows) + picture(drawing, 480, "the controller, drawn")

    def __reduce__(self) -> tuple[type[Self], tuple[str]]:
        """Pickle and copy the specification: a copy is at the start of an episode."""
        return type(self), (self._text,)

    def __repr__(self) -> str:
        """Return the kind with the parameters or the sizes."""
        kind = self.specification.get("kind")
        if self.parameters:
            return f"<Controller {kind}: {self.parameters}>"
        return f"<Controller {kind}: {self.sensors} sensors, {self.actuators} actuators>"


class ControlledEpisodes:
    """A controller for the agents of several episodes, with a separate state for each agent of each episode.

    Args:
        controller: steers the agents; its state does not change.
    """

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._swarm = controller._python_swarm()  # a new one, at the start of an episode
        self._whole = controller._whole
        self._rows: dict[tuple[int, int], int] = {}  # (episode, agent): row in the swarm
        self._agents: dict[tuple[int, int], _engine.Controller] = {}

    def __call__(
        self, episodes: NDArray[np.uint32], agents: NDArray[np.uint32], sensors: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Return the actuators of agents that act, (rows, actuators).

        Args:
            episodes: (rows,), the episode of each.
            agents: (rows,), the number of each in its episode, from 0.
            sensors: (rows, sensors), finite.

        Raises InputError for an agent that belongs to no group of a team.
        """
        keys = list(zip(episodes.tolist(), agents.tolist(), strict=True))
        if self._swarm is not None:
            return self._swarm.step(self._find_rows(self._swarm, keys), sensors)
        if self._controller._is_stateless:
            return self._controller(sensors)
        assert self._whole is not None
        with engine_errors("controller: "):
            for key in keys:
                if key not in self._agents:
                    self._agents[key] = self._whole.of_agent(key[1])
        return _step_agents([self._agents[key] for key in keys], sensors, self._controller.actuators)

    def _find_rows(self, swarm: Swarm, keys: list[tuple[int, int]]) -> NDArray[np.int64]:
        """Return the rows of agents in the swarm, which grows by those that have not acted before."""
        before = len(self._rows)
        for key in keys:
            self._rows.setdefault(key, len(self._rows))
        if (after := len(self._rows)) > before:
            owners = np.zeros(after, dtype=np.int64)
            if before:
                swarm.extend(owners, before, after)
            else:
                swarm.restart(owners)
        return np.array([self._rows[key] for key in keys], dtype=np.int64)


def _step_agents(
    agents: Sequence[_engine.Controller], rows: NDArray[np.float32], actuators: int
) -> NDArray[np.float32]:
    """Return the actuators of agents, (agents, actuators); 0 beyond those of an agent's group."""
    actuator_rows = np.zeros((len(rows), actuators), dtype=np.float32)
    with engine_errors("sensors: "):
        for agent, row, values in zip(agents, rows, actuator_rows, strict=True):
            step = agent.step(row)
            values[: len(step)] = step
    return actuator_rows


def genome_beside(file: Path) -> Any:  # noqa: ANN401 - whatever the file says
    """Return the genome beside the controller in a run's `best.json`; None if the file has none."""
    values = None if file.suffix in {".yaml", ".yml"} else _read(file)
    if not isinstance(values, dict) or not isinstance(values.get("controller"), dict):
        return None
    return values.get("genome")


def _read(file: Path) -> Any:  # noqa: ANN401 - whatever the file says
    """Parse a JSON file. Raises InputError when it cannot be read or is not JSON."""
    try:
        return loads(read_bytes(file, _LARGEST_FILE_BYTES))
    except FileNotFoundError:
        raise InputError(f"{file}: file not found") from None
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(
            f"{file}: is not a text file. Pass a specification in JSON (best.json of a run, controller.json "
            "of a bundle), a run folder, or a machine in YAML; exported models and code cannot be loaded"
        ) from error
    except ValueError as error:
        raise InputError(f"{file}: is not valid JSON: {error}") from error


def _import_modules(specification: Mapping[str, Any], folder: Path) -> None:
    """Import the modules that are named by files, from this folder or this run."""
    try:
        import_modules(specification, folder)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"controller: invalid machine of modules: {describe_exception(error)}") from error
