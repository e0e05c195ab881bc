"""Episodes whose agents are steered by code of one's own: hand-written controllers, learning."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmwright import _engine
from swarmwright.core.arguments import checked, function, listed, mapping, simulation_seed
from swarmwright.core.arrays import float32_of
from swarmwright.core.errors import InputError, engine_errors
from swarmwright.core.processes import use_threads
from swarmwright.core.suggestions import did_you_mean
from swarmwright.display import Caption, Recording, Scene
from swarmwright.display.files import save
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.fitness import Fault
from swarmwright.simulations import catalogue


class Observation(NamedTuple):
    """What the agents sense that act next, a row each."""

    episodes: NDArray[np.uint32]
    """(rows,), the index of the episode among `seeds`."""
    agents: NDArray[np.uint32]
    """(rows,), the number of the agent in its episode, from 0."""
    sensors: NDArray[np.float32]
    """(rows, sensors), what it senses."""


class Episodes:
    """Episodes of a simulation in this process, stepped side by side; your code steers the agents.

        episodes = swarmwright.Episodes("arena", {"mission": "aggregation"}, seeds=range(100))
        while not episodes.done:
            seen = episodes.observe()
            episodes.step(rule(seen.sensors))
        print(episodes.fitness.mean())

    An episode is the same as in `evaluate` with this seed: a controller that does what `rule` does gets the
    same fitness.

    Args:
        simulation: the name of a built-in simulation, `FILE:Class`, a class, or an experiment: then its
            simulation, parameters and fitness are used.
        parameters: of the simulation, as in an experiment; for an experiment, those that differ.
        seeds: of the simulation, from 0 to 2**63 - 1, one for each episode; at least one.
        watch: keep what the first episode looks like at each step, for `save`.

    Raises:
        InputError: the simulation is not here, or does not take these parameters or seeds.
        RunError: the code of the simulation failed.
    """

    def __init__(
        self,
        simulation: Experiment | str | type,
        parameters: Mapping[str, Any] | None = None,
        *,
        seeds: Iterable[int] = (0,),
        watch: bool = False,
    ) -> None:
        self.experiment = _experiment(simulation, parameters)
        listed("seeds", seeds, "integers such as [0, 1, 2]")
        self.seeds: list[int] = [simulation_seed(f"seeds[{index}]", one) for index, one in enumerate(seeds)]
        if not self.seeds:
            raise InputError("seeds: is empty, expected at least one")
        description = catalogue.description(self.experiment.simulation, self.experiment.parameters)
        self.sensors: int = description["sensors"]
        """Sensor values of an agent; those of an agent that has fewer are followed by zeros."""
        self.actuators: int = description["actuators"]
        """Actuator values of an agent; of an agent that has fewer, the last ones have no effect."""
        self.sensor_names: list[str] = list(description["sensor_names"])
        """What they are called, in their order; [] where the simulation does not say."""
        self.actuator_names: list[str] = list(description["actuator_names"])
        """What they are called, in their order; [] where the simulation does not say."""
        playable = catalogue.playable(self.experiment.simulation)
        with engine_errors():
            self._episodes = _engine.Episodes(playable, dict(self.experiment.parameters), self.seeds)
        self._host: Any = None if isinstance(playable, str) else playable
        self._seen: Observation | None = None
        self._scenes: list[Scene] | None = [] if watch else None
        self._fitness_so_far: list[float] = []
        self._watch()

    @property
    def done(self) -> bool:
        """Whether all have ended."""
        return self._episodes.done

    @property
    def acts_in_turn(self) -> bool:
        """Of the first episode: whether agents act in turn, and others have yet to in this step."""
        return self._episodes.mid_step

    @property
    def is_truncated(self) -> bool:
        """Of the first episode: whether a simulation in Python says that it has ended as its time was over.

        Raises RunError when the code of the simulation failed.
        """
        if not (self._episodes.done and hasattr(self._host, "truncated")):  # missions have time alone
            return False
        with engine_errors():
            return bool(self._host.truncated())

    @property
    def step_seconds(self) -> float:
        """Seconds of a step, as pictures show it."""
        return self._episodes.step_size

    def observe(self) -> Observation:
        """Return the agents that act next, in the order of episodes, and what they sense.

        Episodes that have ended are left out. The same until the next step, also for sensors with noise.
        """
        if self._seen is None:
            with engine_errors():
                self._seen = Observation(*self._episodes.acting())
        return self._seen

    def step(self, actuators: ArrayLike) -> None:
        """Let all agents of `observe` act, and go on by one step in the episodes that have not ended.

        Args:
            actuators: (rows, actuators), the rows of `observe`; numbers are limited to -1..1.

        Raises:
            InputError: another shape, a number is not finite, or all episodes have ended.
            RunError: the code of the simulation failed, or there are several episodes and this process was
                forked from one in which the engine had computed.
        """
        if self.done:
            raise InputError("step: all episodes have ended")
        rows = float32_of("actuators", actuators)
        expected = (len(self.observe().agents), self.actuators)
        if rows.shape != expected:
            raise InputError(
                f"actuators: have the shape {rows.shape}; expected {expected}, a row for each agent that acts"
            )
        if not np.isfinite(rows).all():
            row, column = np.argwhere(~np.isfinite(rows))[0].tolist()
            raise InputError(f"actuators: {rows[row, column]} at [{row}, {column}], expected finite numbers")
        if len(self.seeds) > 1:  # the engine steps one episode without its threads
            use_threads()
        with engine_errors():
            self._episodes.step(np.clip(rows, -1.0, 1.0))
        self._seen = None
        self._watch()

    def run(self, controller: Callable[[Observation], ArrayLike]) -> NDArray[np.float64]:
        """Step to the end of all episodes and return the fitness, (episodes,).

        Args:
            controller: takes an `Observation`, returns actuators as in `step`.
        """
        function("controller", controller, ["observation"])
        while not self.done:
            self.step(controller(self.observe()))
        return self.fitness

    @property
    def fitness(self) -> NDArray[np.float64]:
        """Fitness so far, (episodes,); NaN where the experiment's expression has no value."""
        return self.fitness_and_faults()[0]

    def fitness_and_faults(self) -> tuple[NDArray[np.float64], list[Fault]]:
        """Return the fitness so far, and why the experiment's expression has no value where it has none."""
        expression = self.experiment.fitness_expression
        with engine_errors():
            own = self._episodes.fitness()
            if expression is None:
                return own, []
            return expression(own, self._episodes.metrics(list(expression.metrics)))

    @property
    def metrics(self) -> dict[str, NDArray[np.float64]]:
        """All metrics of the simulation so far, by name, (episodes,) each."""
        names = self._episodes.metric_names
        with engine_errors():
            values = self._episodes.metrics(names)
        return {name: values[:, index].copy() for index, name in enumerate(names)}

    def scene(self) -> Scene:
        """Return what the first episode looks like now. Raises RunError when there is nothing to show."""
        with engine_errors():
            return Scene.of(self._episodes.scene())

    @checked
    def save(self, path: str | Path, *, speed: float = 1.0) -> None:
        """Write the first episode as a picture (.png), an animation (.gif), a film (.mp4) or a page (.html).

        Args:
            path: of the file, is written over.
            speed: how many times faster than in the simulation.

        Raises InputError without `watch`, for another ending, and when the file cannot be written.
        """
        if self._scenes is None:
            raise InputError("save: nothing was kept; write Episodes(.., watch=True)")
        recording = Recording(tuple(self._scenes), tuple(self._fitness_so_far), self._episodes.step_size)
        title = f"{self.experiment.label}, simulation seed {self.seeds[0]}"
        try:
            save(recording, Path(path), caption=Caption(title), speed=speed)
        except ValueError as error:
            raise InputError(f"path: {error}") from None
        except OSError as error:
            raise InputError(f"path: {path}: cannot be written: {error.strerror}") from error

    def _watch(self) -> None:
        if self._scenes is None or self._episodes.mid_step:
            return
        scene = self.scene()
        if not self._scenes or scene.step > self._scenes[-1].step:  # it has not ended before the others
            self._scenes.append(scene)
            self._fitness_so_far.append(float(self.fitness[0]))


def _experiment(simulation: Experiment | str | type, parameters: Mapping[str, Any] | None) -> Experiment:
    if parameters is not None:
        mapping("parameters", parameters, '{"mission": "aggregation"}')
    if isinstance(simulation, Experiment):
        found = simulation if not parameters else simulation.replace(parameters=dict(parameters))
    elif isinstance(simulation, str | type):
        found = Experiment.from_mapping({"simulation": simulation, "parameters": dict(parameters or {})})
    else:
        raise InputError(
            "simulation: must be a name such as 'arena', a class or an Experiment, "
            f"not an object of the class {type(simulation).__name__}"
        )
    if not catalogue.is_here(found.simulation):
        hint = did_you_mean(found.simulation, catalogue.titles())
        raise InputError(f"simulation: {found.simulation!r} is not built in, nor a class in Python{hint}")
    return found
