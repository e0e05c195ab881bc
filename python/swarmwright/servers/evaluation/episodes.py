"""Episodes whose agents are controlled by your own code: hand-written controllers, learning."""

from collections.abc import Callable, Iterable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmwright import _engine
from swarmwright.common.arguments import check_arguments, function, mapping, require_list, simulation_seed
from swarmwright.common.arrays import float32_of
from swarmwright.common.errors import InputError, engine_errors
from swarmwright.common.processes import use_threads
from swarmwright.common.values import are_equal
from swarmwright.controllers.controller import ControlledEpisodes, Controller
from swarmwright.display import Caption, Recording, Scene
from swarmwright.display.files import save
from swarmwright.display.pictures import Pictures
from swarmwright.display.pictures import save as save_pictures
from swarmwright.experiment.derived import fitness_expression
from swarmwright.experiment.experiment import Experiment, as_experiment
from swarmwright.simulations import catalogue, near_names
from swarmwright.simulations.fitness import Fault


class Observation(NamedTuple):  # noqa: PLW1641 - arrays have no hash, nor have tuples of them
    """Sensor values of the agents that act next, one row each. Observations with equal values are equal."""

    episodes: NDArray[np.uint32]
    """(rows,), the index of the episode among `seeds`."""
    agents: NDArray[np.uint32]
    """(rows,), the number of the agent in its episode, from 0."""
    sensors: NDArray[np.float32]
    """(rows, sensors), its sensor values."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, tuple) and are_equal(tuple(self), tuple(other))

    def __ne__(self, other: object) -> bool:
        return not self == other


class Episodes:
    """Episodes of a simulation in this process, stepped side by side and controlled by your code.

        episodes = swarmwright.Episodes("arena", {"mission": "aggregation"}, seeds=range(100))
        while not episodes.done:
            observation = episodes.observe()
            episodes.step(rule(observation.sensors))
        print(episodes.fitness.mean())

    An episode equals that of `evaluate` with the same seed: a controller that behaves like `rule` gets the
    same fitness.

    Args:
        simulation: the name of a built-in simulation, `FILE:Class`, a class, or an experiment (object, .yaml
            file or mapping), whose simulation, parameters and fitness are used.
        parameters: parameters of the simulation, as in an experiment; for an experiment, those that differ.
        seeds: seeds of the simulation, from 0 to 2**63 - 1, one for each episode; at least one.
        watch: record the first episode, for `save`.

    Raises:
        InputError: the simulation is not available in this process, refuses the parameters or seeds, or
            cannot be watched.
        SimulationError: the code of the simulation failed.
    """

    _draws: ClassVar[bool] = False
    """Whether the first episode can be drawn at each step."""

    def __init__(
        self,
        simulation: Experiment | Mapping[str, Any] | str | PathLike[str] | type,
        parameters: Mapping[str, Any] | None = None,
        *,
        seeds: Iterable[int] = (0,),
        watch: bool = False,
    ) -> None:
        self.experiment = _load_experiment(simulation, parameters)
        require_list("seeds", seeds, "integers such as [0, 1, 2]")
        self.seeds: list[int] = [simulation_seed(f"seeds[{index}]", seed) for index, seed in enumerate(seeds)]
        if not self.seeds:
            raise InputError("seeds: is empty, expected at least one")
        description = catalogue.description(self.experiment.simulation, self.experiment.parameters)
        self.sensors: int = description["sensors"]
        """Number of sensor values of an agent; agents with fewer are padded with zeros."""
        self.actuators: int = description["actuators"]
        """Number of actuator values of an agent; agents with fewer ignore the last ones."""
        self.sensor_names: list[str] = list(description["sensor_names"])
        """Their names, in order; [] if the simulation gives none."""
        self.actuator_names: list[str] = list(description["actuator_names"])
        """Their names, in order; [] if the simulation gives none."""
        drawn = watch or self._draws
        self._pictured = drawn and catalogue.choose_display(self.experiment.simulation) == "picture"
        find = catalogue.make_drawing_host if self._pictured else catalogue.make_playable
        playable: Any = find(self.experiment.simulation)
        self._host: Any = None if isinstance(playable, str) else playable
        with self._errors():
            self._episodes = _engine.Episodes(playable, dict(self.experiment.parameters), self.seeds)
        self._observation: Observation | None = None
        self._scenes: list[Scene] | None = [] if watch and not self._pictured else None
        self._fitness_so_far: list[float] = []
        self._pictures = Pictures(playable.picture) if watch and self._pictured else None
        self._record_frame(moved=True)

    def __repr__(self) -> str:
        """Return the simulation's name and the number of episodes."""
        state = ", all ended" if self.done else ""
        return f"<Episodes of {self.experiment.label}: {len(self.seeds)}{state}>"

    @property
    def done(self) -> bool:
        """Whether all episodes have ended."""
        return self._episodes.done

    @property
    def acts_in_turn(self) -> bool:
        """Whether agents of the first episode act in turn and some have yet to act in this step."""
        return self._episodes.mid_step

    @property
    def is_truncated(self) -> bool:
        """Whether a simulation in Python declares that the first episode ended because its time was over.

        Raises SimulationError when the code of the simulation failed.
        """
        if not (self._episodes.done and hasattr(self._host, "truncated")):  # missions always end by time
            return False
        with self._errors():
            return bool(self._host.truncated())

    @property
    def step_seconds(self) -> float:
        """Simulated seconds per step, as shown in pictures."""
        return self._episodes.step_size

    def observe(self) -> Observation:
        """Return the agents that act next and their sensor values, in the order of episodes.

        Ended episodes are left out. Repeated calls before the next step return the same, also with noise.
        """
        if self._observation is None:
            with self._errors():
                self._observation = Observation(*self._episodes.acting())
        return self._observation

    def step(self, actuators: ArrayLike) -> None:
        """Let all agents of `observe` act, and advance the running episodes by one step.

        Args:
            actuators: (rows, actuators), rows as in `observe`; values are clipped to -1..1.

        Raises:
            InputError: wrong shape, a value is not finite, or all episodes have ended.
            SimulationError: the code of the simulation failed.
            RunError: there are several episodes and this process was forked after the engine had started
                its threads.
        """
        if self.done:
            raise InputError("step: all episodes have ended")
        rows = float32_of("actuators", actuators)
        expected = (len(self.observe().agents), self.actuators)
        if rows.shape != expected:
            raise InputError(
                f"actuators: shape is {rows.shape}; expected {expected}, one row per acting agent"
            )
        if not np.isfinite(rows).all():
            row, column = np.argwhere(~np.isfinite(rows))[0].tolist()
            raise InputError(f"actuators: [{row}, {column}] is {rows[row, column]}; expected finite numbers")
        if len(self.seeds) > 1:  # the engine steps one episode without its threads
            use_threads()
        moved = self._is_watched and self._first_goes_on
        with self._errors():
            self._episodes.step(np.clip(rows, -1.0, 1.0))
        self._observation = None
        self._record_frame(moved=moved)

    def run(self, controller: Controller | Callable[[Observation], ArrayLike]) -> NDArray[np.float64]:
        """Step to the end of all episodes and return the fitness, (episodes,).

        Args:
            controller: an evolved controller, whose state is reset for each agent and episode, so that the
                fitness equals that of `evaluate` and `post_evaluate` on these seeds; or a function that takes
                an `Observation` and returns actuators as in `step`.

        Raises:
            InputError: the controller is a parameter set, does not match the simulation's numbers of sensors
                and actuators, or returns actuators that `step` refuses.
            RunError: as in `step`.
        """
        if isinstance(controller, Controller):
            controller = self._as_function(controller)
        else:
            function("controller", controller, ["observation"])
        while not self.done:
            self.step(controller(self.observe()))
        return self.fitness

    def _as_function(self, controller: Controller) -> Callable[[Observation], ArrayLike]:
        """Turn an evolved controller into a function of observations."""
        sizes, expected = (controller.sensors, controller.actuators), (self.sensors, self.actuators)
        if not controller.sensors:
            raise InputError(
                "controller: is a parameter set, which controls no agents; pass its `parameters` to Episodes"
            )
        if sizes != expected:
            raise InputError(
                f"controller: has {sizes[0]} sensors and {sizes[1]} actuators; agents of "
                f"{self.experiment.simulation} have {expected[0]} and {expected[1]}"
            )
        controlled = ControlledEpisodes(controller)
        return lambda seen: controlled(*seen)

    @property
    def fitness(self) -> NDArray[np.float64]:
        """Fitness so far, (episodes,); NaN if the experiment's expression has no value."""
        return fitness_and_faults(self)[0]

    @property
    def metrics(self) -> dict[str, NDArray[np.float64]]:
        """All metrics so far, by name, (episodes,) each."""
        names = self._episodes.metric_names
        with self._errors():
            values = self._episodes.metrics(names)
        return {name: values[:, index].copy() for index, name in enumerate(names)}

    def scene(self) -> Scene:
        """Return the current scene of the first episode.

        Raises InputError for a simulation that draws pictures itself, RunError if there is nothing to show.
        """
        if self._pictured:
            raise InputError(
                "scene: this simulation draws pictures instead of scenes; write them with `save`"
            )
        with self._errors():
            return Scene.from_fields(self._episodes.scene())

    @check_arguments
    def save(self, path: str | PathLike[str], *, speed: float = 1.0) -> None:
        """Write the first episode as a picture (.png), an animation (.gif), a video (.mp4) or a page (.html).

        Args:
            path: path of the file; an existing file is replaced.
            speed: playback speed relative to simulated time.

        Raises InputError without `watch`, for another suffix, and if the file cannot be written.
        """
        caption = Caption(f"{self.experiment.label}, simulation seed {self.seeds[0]}")
        seconds = self._episodes.step_size
        try:
            if self._pictures is not None:
                save_pictures(self._pictures.recording(seconds), Path(path), caption=caption, speed=speed)
            elif self._scenes is not None:
                recording = Recording(tuple(self._scenes), tuple(self._fitness_so_far), seconds)
                save(recording, Path(path), caption=caption, speed=speed)
            else:
                raise InputError("save: nothing was recorded; create the episodes with watch=True")
        except ValueError as error:
            raise InputError(f"path: {error}") from None
        except OSError as error:
            raise InputError(f"path: {path}: cannot be written: {error.strerror}") from error

    def _errors(self) -> engine_errors:
        """Convert the engine's errors to SimulationError, RunError and InputError."""
        return engine_errors(failure=lambda: None if self._host is None else self._host.failure)

    @property
    def _is_watched(self) -> bool:
        """Whether the first episode is recorded."""
        return self._pictures is not None or self._scenes is not None

    @property
    def _first_goes_on(self) -> bool:
        """Whether the first episode has not ended, that is, one of its agents acts next."""
        return not self.done and (len(self.seeds) == 1 or 0 in self.observe().episodes)

    def _record_frame(self, *, moved: bool) -> None:
        """Record a frame of the first episode. moved: it had not ended before this step."""
        if not moved or self._episodes.mid_step:
            return
        if self._pictures is not None:
            self._pictures.keep(float(self.fitness[0]), ended=not self._first_goes_on)
        elif self._scenes is not None:
            self._scenes.append(self.scene())
            self._fitness_so_far.append(float(self.fitness[0]))


def fitness_and_faults(episodes: Episodes) -> tuple[NDArray[np.float64], list[Fault]]:
    """Return the fitness so far, and the faults of the experiment's expression."""
    expression = fitness_expression(episodes.experiment)
    with episodes._errors():
        fitness = episodes._episodes.fitness()
        if expression is None:
            return fitness, []
        return expression(fitness, episodes._episodes.metrics(list(expression.metrics)))


class EpisodeSequence(Episodes):
    """Episodes of a simulation, one after the other, that reuse one object and record nothing.

    Args:
        simulation: as for `Episodes`.
        parameters: as for `Episodes`.
    """

    def __init__(
        self,
        simulation: Experiment | Mapping[str, Any] | str | PathLike[str] | type,
        parameters: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(simulation, parameters)

    def restart(self, seed: int) -> None:
        """Begin the next episode.

        A simulation in Python keeps its object, which saves time.
        seed: from 0 to 2**63 - 1. Raises SimulationError when the code of the simulation failed.
        """
        playable = self.experiment.simulation if self._host is None else self._host
        with self._errors():
            self._episodes = _engine.Episodes(playable, dict(self.experiment.parameters), [seed])
        self.seeds = [seed]
        self._observation = None


class DrawnEpisodes(EpisodeSequence):
    """Episodes that can be drawn at each step, also by the simulation itself."""

    _draws = True

    def picture(self) -> NDArray[np.uint8] | None:
        """Return the simulation's current picture, (height, width, 3); None if it has scenes."""
        if not self._pictured:
            return None
        with self._errors():
            drawn: NDArray[np.uint8] = self._host.picture()
            return drawn


def _load_experiment(simulation: object, parameters: Mapping[str, Any] | None) -> Experiment:
    if parameters is not None:
        mapping("parameters", parameters, '{"mission": "aggregation"}')
    file = isinstance(simulation, PathLike) or (
        isinstance(simulation, str) and simulation.endswith((".yaml", ".yml"))
    )
    if file or isinstance(simulation, Experiment | Mapping):
        experiment = as_experiment(simulation)  # type: ignore[arg-type] # checked above
        experiment = experiment if not parameters else experiment.replace(parameters=dict(parameters))
    elif isinstance(simulation, str | type):
        experiment = Experiment.from_mapping({"simulation": simulation, "parameters": dict(parameters or {})})
    else:
        raise InputError(
            "simulation: must be a name such as 'arena', a class, an Experiment or its file, not a "
            f"{type(simulation).__name__}"
        )
    if not catalogue.is_local(experiment.simulation):
        hint = near_names.suggest_title(experiment.simulation)
        raise InputError(
            f"simulation: {experiment.simulation!r} is neither built in nor a Python class{hint}"
        )
    return experiment
