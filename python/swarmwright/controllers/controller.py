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
from swarmwright.controllers.modules.registered import find
from swarmwright.controllers.teams import is_team, parts_of

_LARGEST_FILE_BYTES = 1 << 28
"""Bytes of a file."""


class Controller:
    """A callable that maps sensor values to actuators, for one agent or a swarm; or simulation parameters.

    Call it with an array of shape (sensors,) for one agent or (agents, sensors) for a swarm; it returns
    float32 of shape (actuators,) or (agents, actuators), each number in -1..1, the same bits as in every
    simulation server. Each agent (row) keeps its state between calls, where the representation has
    one; `reset` begins a new episode. Several episodes at once, and agents that end before others, need a
    state for each agent of each episode: `Episodes.run(controller)` keeps them; elsewhere, take a copy
    (`copy.copy`) for each agent. In a team, rows belong to its groups of agents in their order; what a
    row has beyond the sensors of the agent's group does not count, and what it has beyond its actuators is 0.
    A parameter set steers no agents: it has `parameters` and cannot be
    called. It can be pickled and copied; a copy is at the start of an episode.

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
        self._swarm = self._in_python()
        self._whole: _engine.Controller | None = None  # as the engine has read it, at the start of an episode
        if self._swarm is None:
            with engine_errors("controller: "):
                self._whole = _engine.Controller(self._text)
        self._agents: list[_engine.Controller] = []
        self._started = 0

    def _in_python(self) -> Swarm | None:
        """Return what steps a machine with modules in Python; None for a controller that the engine steps."""
        if f'"{PYTHON_KIND}"' not in self._text:
            return None
        try:
            values = json.loads(self._text)
            if not isinstance(values, dict) or values.get("kind") != PYTHON_KIND:
                return None
            return Swarm(values, np.array([values["weights"]], dtype=np.float32))
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            raise InputError(
                f"controller: is not a machine of modules: {describe_exception(error)}"
            ) from error

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Self:
        """Read a controller: a specification (JSON), a run's `best.json`, or a run folder.

        Or a machine or tree of the built-in behaviours and conditions in YAML, as `swarmwright export --to
        machine` writes it and people edit it. Raises InputError when there is none.
        """
        file = path_of("path", path, "a controller or a run folder")
        if file.is_dir():
            file /= "best.json"
        if file.suffix in {".yaml", ".yml"}:
            from swarmwright.controllers.kinds.modules.representation import specification_of

            return cls(specification_of(file))
        values = _read(file)
        if isinstance(values, dict) and isinstance(values.get("controller"), dict):
            values = values["controller"]
        if not isinstance(values, dict):
            raise InputError(
                f"{file}: is not a controller; a specification is a JSON object with version, kind, "
                "weights, .."
            )
        try:
            if values.get("kind") == PYTHON_KIND:
                _find_modules(values, file.parent)
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
        """Values of a parameter set, by name, as the simulation gets them; {} for what steers agents."""
        return {} if self._whole is None or self._is_team else self._whole.parameters

    @property
    def sensors(self) -> int:
        """Numbers that an agent senses; 0 for a parameter set."""
        return SENSORS if self._whole is None else self._whole.sensors

    @property
    def actuators(self) -> int:
        """Numbers that an agent is steered by; 0 for a parameter set."""
        return ACTUATORS if self._whole is None else self._whole.actuators

    @cached_property
    def _is_stateless(self) -> bool:
        """Whether actuators depend on the sensors of the same step alone, for all agents alike."""
        return self._swarm is None and kind_of(self.specification).stateless

    def reset(self) -> None:
        """Begin a new episode: forget all state, and how many agents there are."""
        self._agents = []
        self._started = 0

    def __call__(self, sensors: ArrayLike) -> NDArray[np.float32]:
        """Return the actuators for the sensors of one agent or of a swarm, see the class.

        Raises InputError for another shape, a number that is not finite, a parameter set, and, where agents
        have a state or differ, another number of agents than in the call before: rows would take over each
        other's state.
        """
        if not self.sensors:
            raise InputError(
                "controller: is a parameter set, which steers no agents; see its `parameters`, or use "
                "`simulate`"
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
            return self._stepped(self._swarm, rows, whole=values.ndim == 2)
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
        actuators = _stepped(agents, rows, self.actuators)
        return actuators if values.ndim == 2 else actuators[0]

    def _stepped(self, swarm: Swarm, rows: NDArray[np.float32], *, whole: bool) -> NDArray[np.float32]:
        self._check_agents(len(rows))
        if not self._started:
            swarm.restart(np.zeros(len(rows), dtype=np.int64))
        self._started = len(rows)
        actuators = swarm.step(np.arange(len(rows)), rows)
        return actuators if whole else actuators[0]

    def _check_agents(self, agents: int) -> None:
        if self._started not in {0, agents}:
            raise InputError(
                f"sensors: {agents} agent(s) now, {self._started} before, and each row keeps the state of "
                "its agent; where agents or episodes end one by one, use Episodes.run(controller), or a copy "
                "of the controller for each agent (copy.copy); call reset() only to begin a new episode"
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
        """Name the kind and the sizes."""
        kind = self.specification.get("kind")
        if self.parameters:
            return f"<Controller {kind}: {self.parameters}>"
        return f"<Controller {kind}: {self.sensors} sensors, {self.actuators} actuators>"


class ControlledEpisodes:
    """A controller for the agents of several episodes; each agent of each episode has a state of its own.

    Args:
        controller: steers agents; its own state is left as it is.
    """

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._swarm = controller._in_python()  # another one, at the start of an episode
        self._whole = controller._whole
        self._places: dict[tuple[int, int], int] = {}  # in the swarm, of an agent of an episode
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
        who = list(zip(episodes.tolist(), agents.tolist(), strict=True))
        if self._swarm is not None:
            return self._swarm.step(self._placed(self._swarm, who), sensors)
        if self._controller._is_stateless:
            return self._controller(sensors)
        assert self._whole is not None
        with engine_errors("controller: "):
            for agent in who:
                if agent not in self._agents:
                    self._agents[agent] = self._whole.of_agent(agent[1])
        return _stepped([self._agents[agent] for agent in who], sensors, self._controller.actuators)

    def _placed(self, swarm: Swarm, who: list[tuple[int, int]]) -> NDArray[np.int64]:
        """Return the places of agents in the swarm, which grows for those that have not acted before."""
        before = len(self._places)
        for agent in who:
            self._places.setdefault(agent, len(self._places))
        if (after := len(self._places)) > before:
            owners = np.zeros(after, dtype=np.int64)
            if before:
                swarm.extend(owners, before, after)
            else:
                swarm.restart(owners)
        return np.array([self._places[agent] for agent in who], dtype=np.int64)


def _stepped(
    agents: Sequence[_engine.Controller], rows: NDArray[np.float32], actuators: int
) -> NDArray[np.float32]:
    """Return what agents do, (agents, actuators); 0 for what an agent of a team has not."""
    made = np.zeros((len(rows), actuators), dtype=np.float32)
    with engine_errors("sensors: "):
        for agent, row, values in zip(agents, rows, made, strict=True):
            step = agent.step(row)
            values[: len(step)] = step
    return made


def genome_beside(file: Path) -> Any:  # noqa: ANN401 - whatever the file says
    """Return the genome that a run's `best.json` has beside its controller; None where there is none."""
    values = None if file.suffix in {".yaml", ".yml"} else _read(file)
    if not isinstance(values, dict) or not isinstance(values.get("controller"), dict):
        return None
    return values.get("genome")


def _read(file: Path) -> Any:  # noqa: ANN401 - whatever the file says
    """Return what a file says. Raises InputError when it cannot be read or is not JSON."""
    try:
        return loads(read_bytes(file, _LARGEST_FILE_BYTES))
    except FileNotFoundError:
        raise InputError(f"{file}: there is no such file") from None
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(
            f"{file}: is not text: a controller is a specification in JSON, such as best.json of a run and "
            "controller.json of a bundle, a run folder, or a machine in YAML; exported models and code are "
            "not read"
        ) from error
    except ValueError as error:
        raise InputError(f"{file}: is not valid JSON: {error}") from error


def _find_modules(specification: Mapping[str, Any], folder: Path) -> None:
    """Import the code of modules that are named by files, where it is in the folder, or in that run."""
    try:
        find(specification, folder)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"controller: is not a machine of modules: {describe_exception(error)}") from error
