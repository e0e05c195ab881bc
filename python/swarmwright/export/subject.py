"""What is exported: a candidate of a run, the names of what it senses and does, recorded episodes.

One controller of a team, to be exported by itself.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import InputError, RunError, SwarmwrightError, engine_errors
from swarmwright.common.ranges import CONVERSION, Range, ranges_of, shortest_decimal
from swarmwright.common.simulation_names import SimulationName
from swarmwright.common.suggestions import did_you_mean
from swarmwright.common.warn_once import warn_once
from swarmwright.controllers.kinds import kind_of, words_of
from swarmwright.controllers.source import Evolved
from swarmwright.controllers.source.text import plain
from swarmwright.controllers.teams import is_team, parts_of
from swarmwright.export.arena_words import actuator_meaning, robot_in, sensor_meaning
from swarmwright.export.sequences import Sequences, possible_overflows, random_sequences
from swarmwright.runs.choice import choose
from swarmwright.simulations import catalogue
from swarmwright.simulations.command.ros_definition import RosOptions

if TYPE_CHECKING:
    from swarmwright.runs.choice import Choice
    from swarmwright.runs.run import Run


@dataclass(frozen=True)
class Member:
    """The controller of a group of agents."""

    name: str
    """Of the group."""
    specification: Mapping[str, Any]
    """With its weights."""
    first: int
    """The first agent that has it."""
    last: float
    """The agent after the last one; infinite where all other agents have it."""


def member_of(specification: Mapping[str, Any], group: str | None, where: str) -> Member | None:
    """Return the controller of a group; None where agents do not differ.

    Args:
        specification: the whole controller.
        group: its name, None where none was given.
        where: what has the controller, for messages.

    Raises InputError for a group that there is not, or none for a team.
    """
    if not is_team(specification):
        if group is not None:
            raise InputError(
                f"group: {where} has one controller for all agents; leave the group {group!r} out"
            )
        return None
    names = [str(entry["name"]) for entry in specification["groups"]]
    if group is None:
        raise InputError(
            f"group: {where} has a controller for each group of agents; name one of {', '.join(names)} "
            "(--group NAME)"
        )
    if group not in names:
        hint = did_you_mean(group, names) or f"; there are {', '.join(names)}"
        raise InputError(f"group: {where} has no group {group!r}{hint}")
    first = 0
    for entry in specification["groups"]:
        last = float("inf") if entry["agents"] is None else first + int(entry["agents"])
        if entry["name"] == group:
            return Member(group, parts_of(specification)[group], first, last)
        first = int(last)
    raise AssertionError(group)


_EPISODES = 5
_STEPS = 20_000
"""Sensor-actuator exchanges that are recorded; then the episode under way is finished, and no other begun."""
_GOLDEN = 4_000
"""Numbers in a self-test, about."""
RANDOM = "random"
"""The name of a sensor that is no measurement: a new random number in each step."""
_EPISODES_WITHOUT = 20
"""Random sequences in a self-test of a controller whose simulation cannot be run."""


@dataclass(frozen=True)
class Channel:
    """A sensor or an actuator."""

    name: str
    """The simulation's own, any text: each format quotes it."""
    unit: str
    """As the name; empty where it is not known, and where the value is scaled: the range has it then."""
    limits: str
    """Between which values it lies, and what they stand for or mean: any text, as the name."""
    range: Range | None = None
    """What -1 and 1 stand for, of a value that is scaled; see `Range` for the conversion."""


@dataclass(frozen=True)
class Subject(Evolved):
    """A controller and where it comes from."""

    facts: tuple[tuple[str, str], ...] = ()
    """Where it comes from, in lines of a name and a text."""
    description: Mapping[str, Any] = field(default_factory=dict)
    """Of sensors and actuators, see `catalogue.channels`; empty where it is not known.

    Besides these, `sensor_meanings` and `actuator_meanings` where they are known: a text for each, or none.
    """
    episodes: Sequences | None = None
    """What the agents sensed and did in episodes of the run; None where the simulation could not be run."""
    episode_count: int = 0
    reason: str = ""
    """Why there are no episodes."""
    topics: Mapping[str, Any] = field(default_factory=dict)
    """Of robots of a ROS system: sensors and actuators as in a mapping, and the rate where it is known.

    Names of topics may contain {robot}, which stands for the robot's name and which no mapping may have.
    """
    values: Mapping[str, Any] = field(default_factory=dict)
    """Of a parameter set, by name."""
    ranges: Mapping[str, str] = field(default_factory=dict)
    """Of the parameters of a parameter set, in words."""
    step_size: float = 0.0
    """Seconds of a step in the world that is simulated; 0 where they are not known."""
    wheels: tuple[float, float] = (0.0, 0.0)
    """Of a robot with two wheels: metres per second for 1, and between the wheels; 0 where not known."""
    shown_seconds: float = 0.0
    """Seconds for which a step is shown; 0 where they are not known."""

    @property
    def unknown(self) -> str:
        """What is not known of its sensors and actuators, and why; empty where they are described."""
        if not self.steers or self.description:
            return ""
        return f"names, units and ranges of sensors and actuators are not known: {self.reason}"

    @property
    def steers(self) -> bool:
        """Whether it steers agents, which a parameter set does not."""
        return "sensors" in self.specification

    @cached_property
    def sensors(self) -> list[Channel]:
        """The sensors, in their order; their limits are those seen in the recorded episodes."""
        seen = self.episodes.sensors if self.episodes is not None and len(self.episodes) else None
        found = []
        for index, (name, unit, stands_for) in enumerate(self._channels("sensor")):
            limits = "any finite number" if self.description else "range and scale not known"
            if seen is not None:
                low, high = (
                    shortest_decimal(float(end)) for end in (seen[:, index].min(), seen[:, index].max())
                )
                limits = f"{low} to {high} in the recorded episodes"
            if name == RANDOM and stands_for is None:
                limits = "a new random number from 0 to 1 in each step, another one on each robot"
            if stands_for is not None:
                limits = (
                    stands_for.scaled_words
                    if seen is None
                    else f"{stands_for.scaled_words}, scaled: {limits}"
                )
            found.append(Channel(name, unit, self._with_meaning("sensor", index, limits), stands_for))
        return found

    def _with_meaning(self, what: str, index: int, limits: str) -> str:
        meanings = self.description.get(f"{what}_meanings", ())
        meaning = str(meanings[index]) if index < len(meanings) else ""
        return f"{limits}; {meaning}" if meaning else limits

    @cached_property
    def actuators(self) -> list[Channel]:
        """The actuators, in their order."""
        return [
            Channel(
                name,
                unit,
                self._with_meaning(
                    "actuator", index, "-1 to 1" if stands_for is None else stands_for.scaled_words
                ),
                stands_for,
            )
            for index, (name, unit, stands_for) in enumerate(self._channels("actuator"))
        ]

    @property
    def conversion(self) -> tuple[str, ...]:
        """Lines that say how values become numbers of the controller; none where none is scaled."""
        return (
            CONVERSION
            if any(channel.range is not None for channel in [*self.sensors, *self.actuators])
            else ()
        )

    def _channels(self, what: str) -> list[tuple[str, str, Range | None]]:
        """Return name, unit and range of each. Raises ValueError for ranges of a bundle that are none."""
        count = int(self.specification[f"{what}s"])
        names = list(self.description.get(f"{what}_names", ()))
        units = list(self.description.get(f"{what}_units", ()))
        if len(names) != count:
            names = [f"{what} {index}" for index in range(count)]
        if len(units) != count:
            units = [""] * count
        ranges = ranges_of(self.description.get(f"{what}_ranges", ()), count) or (None,) * count
        return [
            (str(name), str(unit), None)
            if stands_for is None
            else (str(name), "", stands_for._replace(unit=stands_for.unit or str(unit)))
            for name, unit, stands_for in zip(_different(names, what), units, ranges, strict=True)
        ]

    @cached_property
    def checks_random(self) -> bool:
        """Whether exported steps refuse a random number that is not from 0 to 1: for a robot.

        Not where a recorded episode has another one: in that simulation, the sensor is something else.
        """
        sensor = kind_of(self.specification).random_sensor
        if sensor is None:
            return False
        if self.episodes is None:
            return True
        recorded = self.episodes.sensors[:, sensor]
        return bool(((recorded >= 0) & (recorded <= 1)).all())

    @cached_property
    def tried(self) -> Sequences:
        """What self-tests begin with: whole sequences, in some of which a network may overflow."""
        if self.episodes is None or not len(self.episodes):
            return random_sequences(self.specification, _EPISODES_WITHOUT, refused=False)
        width = self.episodes.sensors.shape[1] + self.episodes.actuators.shape[1]
        return self.episodes.until(_GOLDEN // width)


def _different(names: list[Any], what: str) -> list[str]:
    """Return a different name for each: empty ones and those that occur twice are numbered, from 0."""
    texts = [str(name).strip() and str(name) for name in names]
    counts = Counter(texts)
    found: dict[str, None] = {}
    for index, text in enumerate(texts):
        name = text or f"{what} {index}"
        if counts[text] > 1 and text:
            name = f"{text} {index}"
        while name in found:
            name = f"{name} {index}"
        found[name] = None
    return list(found)


def subject_of(
    run: "Run", generation: int | None = None, candidate: int | None = None, group: str | None = None
) -> Subject:
    """Return what is exported of a run.

    Its simulation is run to record episodes, where that is possible here.

    Args:
        run: with at least one finished generation.
        generation: as in `Run.evaluation`.
        candidate: as in `Run.evaluation`.
        group: of agents, whose controller is exported; needed in a team.

    Raises:
        InputError: there is no such candidate or group, or its evaluation failed.
    """
    try:
        chosen = choose(run, generation, candidate)
    except RunError as error:
        raise InputError(str(error)) from error
    where = f"candidate {chosen.candidate} of generation {chosen.generation}"
    if np.isnan(chosen.fitness):
        raise InputError(
            f"{run.path}: the evaluation of {where} failed; name one with a fitness: --candidate G:N"
        )
    facts = _facts(run, chosen)
    part = member_of(chosen.specification, group, str(run.path))
    if part is not None:
        facts = (
            *facts[:-1],
            ("Group", plain(part.name)),
            ("Controller", words_of(part.specification)),
        )
    specification = chosen.specification if part is None else part.specification
    if "sensors" not in specification:
        return _parameter_set(run, chosen, facts)
    topics, real_time = _of_ros(run.experiment.simulation)
    if not catalogue.is_local(run.experiment.simulation):
        reason = f"the simulation {run.experiment.label!r} is not available in this process"
    elif real_time:
        reason = "its robots move in real time, and are not driven for that"
    else:
        try:
            return _of_arena(run, _recorded(run, chosen, part, Subject(specification, facts, topics=topics)))
        except SwarmwrightError as error:
            reason = str(error)
    known = _described(run)
    description, step = _of_part(known, part), _step_seconds(known)
    subject = Subject(specification, facts, description, reason=reason, topics=topics, step_size=step)
    subject = _of_arena(run, subject)
    if subject.unknown:
        warn_once(f"{run.path}: {subject.unknown}")
    return subject


def _of_ros(simulation: str) -> tuple[Mapping[str, Any], bool]:
    """Return the topics of robots of a ROS system, and whether they move by themselves, maybe real ones."""
    if SimulationName.parse(simulation).prefix != SimulationName.ROS:
        return {}, False
    definition = RosOptions.of(simulation)
    topics: dict[str, Any] = dict(definition.topics)
    if definition.step.duration is not None:
        topics["rate"] = 1 / definition.step.duration
    return topics, definition.step.duration is not None


def fitness_words(fitness: float, aggregation: str) -> str:
    """Return what is said of the fitness in every format; aggregation: of how many episodes, in words."""
    return f"{fitness + 0.0!r} ({aggregation})" if aggregation else f"{fitness + 0.0!r}"


def _facts(run: "Run", chosen: "Choice") -> tuple[tuple[str, str], ...]:
    experiment = run.experiment
    rows = [
        ("Run", f"{run.name}, seed {experiment.seed}, record SHA-256 {run.digest}"),
        ("Simulation", experiment.label),
        ("Candidate", f"{chosen.candidate} of generation {chosen.generation} (both from 0)"),
        ("Fitness", fitness_words(chosen.fitness, chosen.aggregation)),
        ("Controller", words_of(chosen.specification)),
    ]
    return tuple((name, plain(text)) for name, text in rows)


def _parameter_set(run: "Run", chosen: "Choice", facts: tuple[tuple[str, str], ...]) -> Subject:
    from swarmwright.controllers.controller import Controller  # noqa: PLC0415 - loads the engine

    options = run.experiment.controller.model_dump().get("parameters", {})
    options = options if isinstance(options, dict) else {}  # a plug-in may have other ones
    ranges = {
        name: f"{shortest_decimal(option['range'][0])} to {shortest_decimal(option['range'][1])}"
        for name, option in options.items()
        if option.get("range") is not None
    }
    values = Controller(chosen.specification).parameters
    return Subject(chosen.specification, facts, values=values, ranges=ranges)


def _described(run: "Run") -> Mapping[str, Any]:
    """Return what the run has stored of the simulation, see `catalogue.channels`."""
    return run._store.channels() or {}


def _of_part(channels: Mapping[str, Any], part: Member | None) -> Mapping[str, Any]:
    """Return what is known of sensors and actuators of all agents, or of a group."""
    if part is None:
        return channels
    found: Mapping[str, Any] = channels.get("groups", {}).get(part.name, channels)
    return found


def _of_arena(run: "Run", subject: Subject) -> Subject:
    """Return a subject with what sensors and actuators of the arena's robots stand for."""
    experiment = run.experiment
    if catalogue.find_built_in(experiment.simulation) != catalogue.ARENA or not subject.description:
        return subject
    robot = robot_in(experiment.parameters)
    meanings = {
        "sensor_meanings": [sensor_meaning(sensor.name, robot) for sensor in subject.sensors],
        "actuator_meanings": [actuator_meaning(actuator.name, robot) for actuator in subject.actuators],
    }
    return replace(
        subject,
        description={**subject.description, **meanings},
        wheels=(robot.max_speed, robot.wheel_base) if robot.wheel_base else (0.0, 0.0),
    )


def _step_seconds(channels: Mapping[str, Any]) -> float:
    return float(channels.get("step_seconds") or 0.0)


def _recorded(run: "Run", chosen: "Choice", part: Member | None, subject: Subject) -> Subject:
    """Return a subject with the simulation's description, and what agents sensed and did in episodes."""
    from swarmwright.runs.replay import Replay  # noqa: PLC0415 - needs displays

    parts: list[tuple[NDArray[np.float32], NDArray[np.float32]]] = []
    done, count = 0, 0
    for number in range(min(_EPISODES, len(chosen.seeds))):
        replay = Replay.of(run, generation=chosen.generation, candidate=chosen.candidate, episode=number)
        agents, shown_seconds = _agents(replay, part)
        done += sum(len(sensors) for sensors, _ in agents)
        count += 1
        parts += agents
        if done > _STEPS:
            break
    known = catalogue.channels(replay.experiment.simulation, replay.experiment.parameters)
    of = subject.specification
    width = (int(of["sensors"]), int(of["actuators"]))
    first = np.zeros(done, np.bool_)
    starts = np.cumsum([0, *(len(sensors) for sensors, _ in parts)])[:-1]
    first[starts] = True
    sensors, actuators = (
        np.concatenate([np.empty((0, width[side]), np.float32), *(part[side] for part in parts)])
        for side in (0, 1)
    )
    accepted = np.ones(done, np.bool_)
    return replace(
        subject,
        description=_of_part(known, part),
        episodes=Sequences(
            first, sensors, actuators, accepted, possible_overflows(of, first, actuators, accepted)
        ),
        episode_count=count,
        step_size=_step_seconds(known),
        shown_seconds=shown_seconds,
    )


_Played = list[tuple[NDArray[np.float32], NDArray[np.float32]]]


def _agents(replay: Any, part: Member | None) -> tuple[_Played, float]:  # noqa: ANN401 - a Replay
    """Return sensors and actuators of each agent (of a group) in an episode; for how long a step is shown."""
    episode = replay.engine_episode()
    rows = []
    with engine_errors():
        while not episode.done:
            rows.append(episode.step_observed())
    if not rows:
        return [], episode.step_size
    agents, sensors, actuators = (np.concatenate(part) for part in zip(*rows, strict=True))
    if part is not None:
        own = (agents >= part.first) & (agents < part.last)
        widths = (int(part.specification["sensors"]), int(part.specification["actuators"]))
        agents, sensors, actuators = agents[own], sensors[own, : widths[0]], actuators[own, : widths[1]]
    played = [(sensors[agents == agent], actuators[agents == agent]) for agent in np.unique(agents)]
    return played, episode.step_size
