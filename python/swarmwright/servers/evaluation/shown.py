"""Episodes of experiments, played for display."""

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeVar, cast

from swarmwright import _engine
from swarmwright.common.arguments import simulation_seed
from swarmwright.common.errors import InputError, RunError, engine_errors
from swarmwright.common.random_numbers import Stream
from swarmwright.common.time_limit import bound_seconds, check_time_limit
from swarmwright.common.untrusted import escape_line
from swarmwright.controllers.controller import Controller
from swarmwright.controllers.kinds import describe_controller
from swarmwright.controllers.machines import machines_of
from swarmwright.controllers.modules.played import PlayedEpisode
from swarmwright.display import Caption, Part, Playable, Recording, record, record_in_parts
from swarmwright.display.files import save
from swarmwright.display.pictures import Pictured, PictureRecording
from swarmwright.display.pictures import record as record_pictures
from swarmwright.display.pictures import save as save_pictures
from swarmwright.experiment.derived import fitness_expression, with_environment
from swarmwright.experiment.robots import list_kinds
from swarmwright.servers.broker.credentials import prepare
from swarmwright.servers.broker.waiting import connect_with_retries
from swarmwright.servers.evaluation.evaluate import check_fit
from swarmwright.servers.evaluation.module_code import is_in_python
from swarmwright.servers.evaluation.opening import open_backend
from swarmwright.simulations import catalogue
from swarmwright.simulations.fitness import JudgedEpisode

if TYPE_CHECKING:
    from swarmwright.common.engine_types import Requirements
    from swarmwright.display import Shown
    from swarmwright.experiment.experiment import Experiment

Result = TypeVar("Result")

ATTEMPTS = 3
"""Attempts at an episode whose messages get lost."""

_LOGGER = logging.getLogger("swarmwright")


def begin(
    experiment: "Experiment", broker: str, parameters: dict[str, Any], controller: str
) -> _engine.RemoteEpisode:
    """Begin an episode on a server that has scenes.

    Args:
        experiment: names simulation, requirements, prefix and time-outs.
        broker: where servers are.
        parameters: parameters of the episode, `seed` among them.
        controller: its specification with weights, as JSON.

    Raises:
        RunError: no broker, no free server with scenes, or the episode did not begin.
        InputError: the address or the requirements cannot be used.
    """
    prepare(broker)
    prefix = with_environment(experiment).prefix
    requirements = cast("Requirements", experiment.requirements.model_dump(exclude_none=True))

    def attempt() -> _engine.RemoteEpisode:
        check_time_limit()
        return _engine.RemoteEpisode(
            broker,
            simulation=catalogue.title(experiment.simulation),
            parameters=parameters,
            requirements=requirements,
            controller=controller,
            prefix=prefix,
            discovery=bound_seconds(experiment.timeouts.discovery),
            step=bound_seconds(experiment.timeouts.step),
        )

    with engine_errors():
        return retry_lost(lambda: connect_with_retries(attempt, experiment.timeouts.connect, _LOGGER.warning))


def record_episode(make: Callable[[], tuple[_engine.RemoteEpisode, Playable]]) -> Recording:
    """Record an episode to its end; restart it if messages get lost.

    make: begins the episode and returns it with its playable view. Raises RunError if all attempts fail.
    """

    def attempt() -> Recording:
        episode, played = make()
        try:
            recording = record(played)
            if episode.missing:
                scenes = f"{episode.missing} scene{'s' * (episode.missing > 1)}"
                _LOGGER.warning("server %d: %s did not arrive and are left out", episode.server, scenes)
            return recording
        finally:
            episode.close()

    with engine_errors():
        return retry_lost(attempt)


def retry_lost(attempt: Callable[[], Result]) -> Result:
    """Call `attempt` again while messages get lost, and return its result.

    Raises RunError with the last reason if all attempts fail.
    """
    for number in range(1, ATTEMPTS + 1):
        try:
            return attempt()
        except _engine.LostError as error:
            reason = escape_line(str(error))
            if number == ATTEMPTS:
                raise RunError(f"{reason}; tried {ATTEMPTS} times") from error
            _LOGGER.warning("%s; restarting the episode", reason)
    raise AssertionError  # the last attempt returns or raises


@dataclass(frozen=True, kw_only=True)
class ShownEpisode:
    """One episode of one controller in the simulation of an experiment."""

    experiment: "Experiment"
    controller: Controller
    seed: int
    """Seed of the simulation."""
    source: Path | None = None
    """Path from which the controller was loaded, if any."""
    broker: str | None = None
    """Broker of the server that computes the episode; None for this process."""

    @classmethod
    def from_experiment(
        cls,
        experiment: "Experiment",
        controller: Path | None = None,
        *,
        seed: int | None = None,
        broker: str | None = None,
    ) -> Self:
        """Prepare an episode of an experiment that has no run yet.

        Args:
            experiment: gives the simulation and parameters.
            controller: file or run folder; by default a random controller, as in `simulate`.
            seed: seed of the simulation, instead of `parameters.seed`.
            broker: a server on it computes the episode and sends its scenes. By default this process does,
                or, for simulations that it lacks, a server on the experiment's broker.

        Raises:
            InputError: the simulation is not available here and no broker is known, or the controller does
                not exist or does not match the simulation.
            RunError: no server offers the simulation.
        """
        seed = experiment.first_seed if seed is None else seed
        simulation_seed("seed", seed)
        if broker is None and not catalogue.is_local(experiment.simulation):
            broker = experiment.broker
            if broker is None:
                raise InputError(
                    f"the simulation '{experiment.simulation}' is not built in; give a broker whose server "
                    "sends scenes (--broker URL) or draws by itself (--visual --broker URL)"
                )
        sensors, actuators = _find_sizes(experiment, broker)
        if controller is None:
            representation = experiment.representation(sensors, actuators)
            genome = representation.initial(Stream(experiment.seed, "initial"))
            played = Controller(representation.specification(genome))
        else:
            played = Controller.load(controller)
            check_fit(played, sensors, actuators, experiment.simulation)
        check_showable(broker, played)
        return cls(experiment=experiment, controller=played, seed=seed, source=controller, broker=broker)

    @property
    def is_pictured(self) -> bool:
        """Whether the simulation draws pictures instead of scenes.

        Raises InputError for a simulation that has neither.
        """
        return self.broker is None and catalogue.choose_display(self.experiment.simulation) == "picture"

    def episode(self) -> Playable:
        """Begin the episode and return it.

        Close an episode on a server that is not played to its end. Raises RunError if no server has scenes.
        """
        if self.broker is not None:
            return self._apply_fitness(self._remote())
        if not self.is_pictured:
            return self._episode(catalogue.make_playable(self.experiment.simulation))
        host = catalogue.make_drawing_host(self.experiment.simulation)
        return Pictured(self._episode(host), host.picture)

    def recording(self, most_bodies: int | None = None) -> Recording:
        """Play the episode and record its scenes.

        most_bodies: in all scenes together, see `record`; episodes of servers have no limit.

        Raises RunError if a server cannot compute or show it, InputError if it has more bodies.
        """
        if self.broker is None:
            with engine_errors():
                return record(self.episode(), most_bodies)

        def make() -> tuple[_engine.RemoteEpisode, Playable]:
            episode = self._remote()
            return episode, self._apply_fitness(episode)

        return record_episode(make)

    def recordings(self, beginning: int, most_bodies: int | None = None) -> Iterator[tuple[Recording, bool]]:
        """Play the episode; yield a recording of its first steps, if it is longer, then of the whole.

        Each recording comes with whether it is complete. An episode of a server is only recorded as a whole.
        beginning: number of first steps. The rest is as in `recording`.
        """
        if self.broker is None:
            with engine_errors():
                yield from record_in_parts(self.episode(), beginning, most_bodies=most_bodies)
        else:
            yield self.recording(), True

    def _remote(self) -> _engine.RemoteEpisode:
        parameters = {**self.experiment.parameters, "seed": self.seed}
        return begin(self.experiment, self.broker or "", parameters, self.controller.json)

    def _apply_fitness(self, episode: Any) -> Playable:  # noqa: ANN401 - one of the engine's
        expression = fitness_expression(self.experiment)
        played: Playable = episode if expression is None else JudgedEpisode(episode, expression)
        return played

    def pictures(self) -> PictureRecording:
        """Play the episode and record the pictures of its simulation."""
        host = catalogue.make_drawing_host(self.experiment.simulation)
        with engine_errors():
            return record_pictures(self._episode(host), host.picture)

    def engine_episode(self) -> _engine.Episode | PlayedEpisode:
        """Begin the episode in the engine, with the simulation's fitness."""
        return self._engine_episode(catalogue.make_playable(self.experiment.simulation))

    def _episode(self, simulation: Any) -> Playable:  # noqa: ANN401 - as the engine takes it
        return self._apply_fitness(self._engine_episode(simulation))

    def _engine_episode(self, simulation: Any) -> _engine.Episode | PlayedEpisode:  # noqa: ANN401 - as the engine takes it
        values = self.controller.specification
        if is_in_python(values):
            with engine_errors():
                return PlayedEpisode(simulation, dict(self.experiment.parameters), self.seed, values)
        evolved = self.controller.parameters  # of a parameter set; {} for controllers of agents
        parameters = {**self.experiment.parameters, **evolved, "seed": self.seed}
        with engine_errors():
            return _engine.Episode(simulation, parameters, self.controller.json)

    def part(self, recording: Recording, name: str = "") -> Part:
        """Combine a recording of the episode with details of its controller."""
        try:
            described = catalogue.description(self.experiment.simulation, self.experiment.parameters)
        except InputError:  # falls back to numbers for sensors and actuators
            described = None
        sensors, actuators = (
            (described["sensor_names"], described["actuator_names"]) if described is not None else ((), ())
        )
        robot_kinds = (
            list_kinds(self.experiment.simulation, self.experiment.parameters)
            if described is not None
            else ()
        )
        try:
            seconds = catalogue.step_seconds(self.experiment.simulation)
        except InputError:
            seconds = None
        machines = machines_of(self.controller.specification)
        return Part(recording, name, machines, sensors, actuators, robot_kinds, seconds)

    def save(
        self,
        file: Path,
        *,
        speed: float = 1.0,
        shown: "Shown | None" = None,
        companions: "Sequence[ShownEpisode]" = (),
        names: Sequence[str] = ("",),
    ) -> Recording | PictureRecording:
        """Play the episode and write a picture, an animation, a video or a page, by the file's suffix.

        Args:
            file: replaced if it exists; its suffix is one of `swarmwright.display.files.FORMATS`.
            speed: playback speed relative to simulated time.
            shown: layers to draw in addition to bodies.
            companions: episodes to show beside this one on a page.
            names: names of all episodes on a page, this one's first.

        Raises:
            InputError: the simulation has nothing to show, or the file cannot be written.
            RunError: a server cannot compute or show it.
        """
        try:
            if not self.is_pictured:
                recordings = [episode.recording() for episode in (self, *companions)]
                parts = [
                    episode.part(recording, name)
                    for episode, recording, name in zip((self, *companions), recordings, names, strict=True)
                ]
                save(parts, file, caption=self.caption(recordings[0]), speed=speed, shown=shown)
                return recordings[0]
            if companions:
                raise InputError("--beside: pictures drawn by a simulation cannot be shown side by side")
            drawn = self.pictures()
            save_pictures(drawn, file, caption=self.caption(drawn), speed=speed)
            return drawn
        except OSError as error:
            raise InputError(f"{file}: cannot be written: {error.strerror or error}") from error

    def metrics(self, recording: Recording | PictureRecording) -> dict[str, float]:
        """Return the metrics that the experiment's fitness needs, at the end of a recording, by name.

        {} for recordings without metrics, such as pictures.
        """
        expression = fitness_expression(self.experiment)
        trace = recording.trace if isinstance(recording, Recording) else None
        if expression is None or trace is None:
            return {}
        return {name: float(trace.metrics[name][-1]) for name in expression.metrics if name in trace.metrics}

    @property
    def title(self) -> str:
        """The title of the episode, one line."""
        return f"{self.experiment.label}: {self.controller_text}, simulation seed {self.seed}"

    @property
    def controller_text(self) -> str:
        """Short description of the controller."""
        if self.source is not None:
            return f"controller of {self.source}"
        return "random values" if self.controller.parameters else "a random controller"

    def caption(self, recording: Recording | PictureRecording | None = None) -> Caption:
        """Return the title and facts to print beside a picture.

        recording: recording of the episode, for its mission and fitness.
        """
        facts = [
            *self._iter_mission(recording),
            ("controller", describe_controller(self.controller.specification)),
        ]
        if recording is not None:
            facts.append(("fitness of this episode", f"{recording.fitness + 0.0:.6g}"))
        return Caption(self.title, (*facts, ("simulation seed", str(self.seed))))

    def _iter_mission(self, recording: Recording | PictureRecording | None) -> Iterator[tuple[str, str]]:
        """Yield the mission's title, that is, the message shared by all scenes."""
        if not isinstance(recording, Recording):
            return
        first, last = recording.scenes[0].message, recording.scenes[-1].message
        if first and first == last and len(recording.scenes) > 1:
            mission = catalogue.find_built_in(self.experiment.simulation) == catalogue.ARENA
            yield ("mission" if mission else "scene", first)


def check_showable(broker: str | None, controller: Controller) -> None:
    """Raise InputError for a controller that servers on a broker cannot show."""
    if broker is not None and is_in_python(controller.specification):
        raise InputError(
            f"broker: {broker}: behaviours and conditions in Python can be shown only in this process; "
            "leave the broker out"
        )


def _find_sizes(experiment: "Experiment", broker: str | None) -> tuple[int, int]:
    """Return the numbers of sensors and actuators of agents, from servers if they are unknown here."""
    if catalogue.has_description(experiment.simulation):
        described = catalogue.description(experiment.simulation, experiment.parameters)
        return described["sensors"], described["actuators"]
    with open_backend(experiment, broker=broker, most=1) as backend:
        return backend.sensors, backend.actuators
