"""The subject of an export: a candidate of a run, its sensors and actuators, and recorded episodes."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
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
from swarmwright.controllers.kinds import describe_controller, kind_of
from swarmwright.controllers.source import Evolved
from swarmwright.controllers.source.text import plain
from swarmwright.controllers.teams import is_team, parts_of
from swarmwright.experiment.robots import DEFAULT, robot_of
from swarmwright.export.sequences import Sequences, draw_random_sequences, find_possible_overflows
from swarmwright.runs.choice import choose
from swarmwright.simulations import catalogue
from swarmwright.simulations.command.ros_definition import RosOptions

if TYPE_CHECKING:
    from swarmwright.runs.choice import Choice
    from swarmwright.runs.run import Run

_E_PUCK = (17.0, 50.0, 90.0, 150.0, 210.0, 270.0, 310.0, 343.0)


@dataclass(frozen=True)
class Robot:
    """Properties of a robot of the arena."""

    max_speed: float = 0.0
    """Largest speed of a wheel, or in any direction, in m/s; 0 if unknown."""
    wheel_base: float = 0.0
    """Distance between the wheels of a differential drive in metres; 0 for other drives."""
    angles: Mapping[str, Sequence[float]] | None = None
    """Angles of proximity and light sensors: degrees counter-clockwise from ahead."""


def _spread_angles(count: int) -> list[float]:
    return [360 * index / count for index in range(count)]


PRESETS = {
    DEFAULT: Robot(0.12, 0.053, {"proximity": _E_PUCK, "light": _E_PUCK}),
    "e-puck-rm1.2": Robot(0.12, 0.053),
    "foot-bot": Robot(0.3, 0.14, {"proximity": _spread_angles(24), "light": _spread_angles(24)}),
    "kilobot": Robot(0.01, 0.0255, {"light": _spread_angles(1)}),
    "turtlebot3": Robot(0.22, 0.16, {"proximity": _spread_angles(36)}),
    "point": Robot(0.2),
}
"""Presets as in engine/worlds/arena/src/robots/model/presets.rs and engine/worlds/arena/src/robots."""
_SENSORS = {
    r"ground( \w+)?": "0 black, 1 white",
    r"messages heard": "the number of messages heard",
    r"messages heard squashed": "1 - 2/(1 + e^n) for n messages heard",
    r"neighbours": "the number of robots in range",
    r"center [xy]": "of the mean position of robots in range, 1 is the range; x is ahead, y left",
    r"heading [xy]": "of the mean of the headings of robots in range, each 1 long; x is ahead, y left",
    r"nearest [xy]": "of the position of the nearest robot in range, 1 is the range; x is ahead, y left",
    r"proximity [xy]": "of a vector towards what is near, at most 1 long; x is ahead, y left",
    r"light [xy]": "of the direction of light, 1 long, or 0 where it is dark; x is ahead, y left",
    r"attraction [xy]": "of the sum of vectors to robots heard, 1/(1 + distance in cm) long, x ahead, y left",
    r"compass [xy]": "of the direction of the arena's x axis; x is ahead, y left",
    r"(left|right) wheel encoder": "what this wheel aimed at in the step before",
    r"message \d+": "the mean of the numbers that robots in range send",
}
"""Descriptions of sensors by a pattern of their full name."""
_RAYS = {"proximity": "0 nothing in range, 1 at the rim", "light": "0 dark, 1 bright"}
"""Descriptions of sensors with an angle, by kind."""


def robot_in(parameters: Mapping[str, Any]) -> Robot:
    """Return the properties of the arena's robot for given parameters; empty for several kinds."""
    robot = robot_of(parameters)
    if not isinstance(robot, Mapping):
        return PRESETS.get(str(robot), Robot())
    preset = PRESETS.get(str(robot.get("preset")), Robot())
    drive, sensors = robot.get("drive", {}), robot.get("sensors")
    drive = drive if isinstance(drive, Mapping) else {}
    angles = preset.angles
    if isinstance(sensors, Mapping) or robot.get("preset") is not None:
        angles = None if sensors else angles  # some of them may differ
    elif isinstance(sensors, Sequence):
        angles = {
            str(sensor.get("kind")): sensor.get("angles") or _spread_angles(int(sensor.get("count", 0)))
            for sensor in sensors
            if isinstance(sensor, Mapping)
        }
    differential = drive.get("kind", "differential") == "differential"
    return Robot(
        float(drive.get("max_speed", preset.max_speed)),
        float(drive.get("wheel_base", preset.wheel_base)) if differential else 0.0,
        angles,
    )


def describe_sensor(name: str, robot: Robot) -> str:
    """Describe a sensor; empty if unknown."""
    kind, _, index = name.partition(" ")
    if kind in _RAYS and index.isdecimal():
        angles = (robot.angles or {}).get(kind, ())
        if int(index) >= len(angles):
            return _RAYS[kind]
        angle = angles[int(index)]
        where = f"{shortest_decimal(angle)} degrees counter-clockwise from ahead" if angle else "ahead"
        return f"{_RAYS[kind]}, {where}"
    part = re.fullmatch(r"attraction (\d+)", name)
    if part:
        return f"robots heard {part[1]} degrees counter-clockwise from ahead"
    return next((words for pattern, words in _SENSORS.items() if re.fullmatch(pattern, name)), "")


def describe_actuator(name: str, robot: Robot) -> str:
    """Describe the values 1 and -1 of an actuator; empty if unknown."""
    speed = f"{shortest_decimal(robot.max_speed)} m/s" if robot.max_speed else "the largest speed"
    if name in {"left wheel", "right wheel"}:
        return f"1 is {speed} forwards, -1 backwards"
    if name == "ahead":
        return f"1 is {speed} ahead, -1 back"
    return {
        "left": f"1 is {speed} to the left, -1 to the right",
        "turn": "above 0 counter-clockwise",
    }.get(name, "")


@dataclass(frozen=True)
class Member:
    """The controller of a group of agents."""

    name: str
    """Name of the group."""
    specification: Mapping[str, Any]
    """Specification with weights."""
    first: int
    """Index of its first agent."""
    last: float
    """Index after its last agent; infinite for all remaining agents."""


def select_member(specification: Mapping[str, Any], group: str | None, label: str) -> Member | None:
    """Return the controller of a group; None if all agents share one controller.

    Args:
        specification: the whole controller.
        group: its name, or None.
        label: name of the run, for messages.

    Raises InputError for an unknown group, or a missing group for a team.
    """
    if not is_team(specification):
        if group is not None:
            raise InputError(f"group: {label} has one controller for all agents; remove the group {group!r}")
        return None
    names = [str(entry["name"]) for entry in specification["groups"]]
    if group is None:
        raise InputError(
            f"group: {label} has a controller for each group of agents; name a group, {', '.join(names)} "
            "(--group NAME)"
        )
    if group not in names:
        hint = did_you_mean(group, names) or f"; its groups are {', '.join(names)}"
        raise InputError(f"group: {label} has no group {group!r}{hint}")
    first = 0
    for entry in specification["groups"]:
        last = float("inf") if entry["agents"] is None else first + int(entry["agents"])
        if entry["name"] == group:
            return Member(group, parts_of(specification)[group], first, last)
        first = int(last)
    raise AssertionError(group)


_EPISODES = 5
_STEPS = 20_000
"""Recorded steps after which no further episode begins."""
_GOLDEN = 4_000
"""Approximate numbers in a self-test."""
RANDOM = "random"
"""Name of a sensor that is a new random number in each step."""
_EPISODES_WITHOUT = 20
"""Random sequences in a self-test without recorded episodes."""


@dataclass(frozen=True)
class Channel:
    """A sensor or an actuator."""

    name: str
    """Name in the simulation, arbitrary text, which each format must quote."""
    unit: str
    """Unit, arbitrary text; empty if unknown, or if the value is scaled and `range` has the unit."""
    limits: str
    """Limits and meaning of the values, arbitrary text."""
    range: Range | None = None
    """Values of -1 and 1 for a scaled value; see `Range` for the conversion."""


@dataclass(frozen=True)
class Subject(Evolved):
    """A controller and its origin."""

    facts: tuple[tuple[str, str], ...] = ()
    """Origin as pairs of name and text."""
    description: Mapping[str, Any] = field(default_factory=dict)
    """Sensors and actuators, see `catalogue.channels`; empty if unknown.

    Also `sensor_meanings` and `actuator_meanings` if known: a text for each, or an empty string.
    """
    episodes: Sequences | None = None
    """Sensors and actuators of agents in episodes of the run; None if the simulation could not be run."""
    episode_count: int = 0
    reason: str = ""
    """Reason for missing episodes."""
    topics: Mapping[str, Any] = field(default_factory=dict)
    """Topics of ROS robots: sensors and actuators as in a mapping, and the rate if known.

    Names of topics may contain {robot}, a placeholder of the robot's name, which is not allowed in mappings.
    """
    values: Mapping[str, Any] = field(default_factory=dict)
    """Values of a parameter set, by name."""
    ranges: Mapping[str, str] = field(default_factory=dict)
    """Ranges of the parameters of a parameter set, as text."""
    step_size: float = 0.0
    """Duration of a step in the simulated world in seconds; 0 if unknown."""
    wheels: tuple[float, float] = (0.0, 0.0)
    """Wheels of a robot: metres per second for 1, and distance between the wheels; 0 if unknown."""
    shown_seconds: float = 0.0
    """Seconds for which a step is shown; 0 if unknown."""

    @property
    def unknown(self) -> str:
        """Message on unknown sensors and actuators; empty if they are described."""
        if not self.steers or self.description:
            return ""
        return f"names, units and ranges of sensors and actuators are unknown: {self.reason}"

    @property
    def steers(self) -> bool:
        """Whether the controller steers agents; False for a parameter set."""
        return "sensors" in self.specification

    @cached_property
    def sensors(self) -> list[Channel]:
        """The sensors in order, with their limits in the recorded episodes."""
        recorded = self.episodes.sensors if self.episodes is not None and len(self.episodes) else None
        channels = []
        for index, (name, unit, stands_for) in enumerate(self._channels("sensor")):
            limits = "any finite number" if self.description else "range and scale not known"
            if recorded is not None:
                low, high = (
                    shortest_decimal(float(end))
                    for end in (recorded[:, index].min(), recorded[:, index].max())
                )
                limits = f"{low} to {high} in the recorded episodes"
            if name == RANDOM and stands_for is None:
                limits = "a new random number from 0 to 1 in each step, another one on each robot"
            if stands_for is not None:
                limits = (
                    stands_for.scaled_words
                    if recorded is None
                    else f"{stands_for.scaled_words}, scaled: {limits}"
                )
            channels.append(Channel(name, unit, self._with_meaning("sensor", index, limits), stands_for))
        return channels

    def _with_meaning(self, noun: str, index: int, limits: str) -> str:
        meanings = self.description.get(f"{noun}_meanings", ())
        meaning = str(meanings[index]) if index < len(meanings) else ""
        return f"{limits}; {meaning}" if meaning else limits

    @cached_property
    def actuators(self) -> list[Channel]:
        """The actuators in order."""
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
        """Lines that explain the conversion of values; empty if no value is scaled."""
        return (
            CONVERSION
            if any(channel.range is not None for channel in [*self.sensors, *self.actuators])
            else ()
        )

    def _channels(self, noun: str) -> list[tuple[str, str, Range | None]]:
        """Return name, unit and range of each channel. Raises ValueError for invalid ranges of a bundle."""
        count = int(self.specification[f"{noun}s"])
        names = list(self.description.get(f"{noun}_names", ()))
        units = list(self.description.get(f"{noun}_units", ()))
        if len(names) != count:
            names = [f"{noun} {index}" for index in range(count)]
        if len(units) != count:
            units = [""] * count
        ranges = ranges_of(self.description.get(f"{noun}_ranges", ()), count) or (None,) * count
        return [
            (str(name), str(unit), None)
            if stands_for is None
            else (str(name), "", stands_for._replace(unit=stands_for.unit or str(unit)))
            for name, unit, stands_for in zip(_make_unique(names, noun), units, ranges, strict=True)
        ]

    @cached_property
    def checks_random(self) -> bool:
        """Whether exported steps refuse a random sensor outside 0..1.

        False if a recorded episode has other values, since the simulation uses the sensor differently.
        """
        sensor = kind_of(self.specification).random_sensor
        if sensor is None:
            return False
        if self.episodes is None:
            return True
        recorded = self.episodes.sensors[:, sensor]
        return bool(((recorded >= 0) & (recorded <= 1)).all())

    @cached_property
    def self_test_sequences(self) -> Sequences:
        """Whole sequences for self-tests, in some of which a network may overflow."""
        if self.episodes is None or not len(self.episodes):
            return draw_random_sequences(self.specification, _EPISODES_WITHOUT, refused=False)
        width = self.episodes.sensors.shape[1] + self.episodes.actuators.shape[1]
        return self.episodes.take_first(_GOLDEN // width)


def _make_unique(names: list[Any], noun: str) -> list[str]:
    """Return unique names: empty and duplicate names are numbered from 0."""
    texts = [str(name).strip() and str(name) for name in names]
    counts = Counter(texts)
    unique: dict[str, None] = {}
    for index, text in enumerate(texts):
        name = text or f"{noun} {index}"
        if counts[text] > 1 and text:
            name = f"{text} {index}"
        while name in unique:
            name = f"{name} {index}"
        unique[name] = None
    return list(unique)


def load_subject(
    run: "Run", generation: int | None = None, candidate: int | None = None, group: str | None = None
) -> Subject:
    """Return the subject of an export from a run.

    The simulation is run to record episodes if it is available.

    Args:
        run: a run with at least one finished generation.
        generation: as in `Run.evaluation`.
        candidate: as in `Run.evaluation`.
        group: group of agents whose controller is exported; required for a team.

    Raises:
        InputError: the candidate or group does not exist, or its evaluation failed.
    """
    try:
        chosen = choose(run, generation, candidate)
    except RunError as error:
        raise InputError(str(error)) from error
    label = f"candidate {chosen.candidate} of generation {chosen.generation}"
    if np.isnan(chosen.fitness):
        infeasible = run.experiment.constraints and np.isfinite(chosen.episodes).all()
        reason = "violates constraints" if infeasible else "failed"
        raise InputError(f"{run.path}: {label} {reason}; name another candidate with --candidate G:N")
    facts = _facts(run, chosen)
    part = select_member(chosen.specification, group, str(run.path))
    if part is not None:
        facts = (
            *facts[:-1],
            ("Group", plain(part.name)),
            ("Controller", describe_controller(part.specification)),
        )
    specification = chosen.specification if part is None else part.specification
    if "sensors" not in specification:
        return _parameter_set(run, chosen, facts)
    topics, real_time = _ros_topics(run.experiment.simulation)
    if not catalogue.is_local(run.experiment.simulation):
        reason = f"the simulation {run.experiment.label!r} is not available in this process"
    elif real_time:
        reason = "its robots move in real time"
    else:
        try:
            return _with_arena_meanings(
                run, _record_episodes(run, chosen, part, Subject(specification, facts, topics=topics))
            )
        except SwarmwrightError as error:
            reason = str(error)
    channels = _load_channels(run)
    description, step = _select_channels(channels, part), _step_seconds(channels)
    subject = Subject(specification, facts, description, reason=reason, topics=topics, step_size=step)
    subject = _with_arena_meanings(run, subject)
    if subject.unknown:
        warn_once(f"{run.path}: {subject.unknown}")
    return subject


def _ros_topics(simulation: str) -> tuple[Mapping[str, Any], bool]:
    """Return the topics of ROS robots, and whether they move in real time."""
    if SimulationName.parse(simulation).prefix != SimulationName.ROS:
        return {}, False
    definition = RosOptions.parse(simulation)
    topics: dict[str, Any] = dict(definition.topics)
    if definition.step.duration is not None:
        topics["rate"] = 1 / definition.step.duration
    return topics, definition.step.duration is not None


def fitness_words(fitness: float, made_of: str) -> str:
    """Describe the fitness, in the same words for every format; made_of: number of episodes, in words."""
    return f"{fitness + 0.0!r} ({made_of})" if made_of else f"{fitness + 0.0!r}"


def _facts(run: "Run", chosen: "Choice") -> tuple[tuple[str, str], ...]:
    experiment = run.experiment
    rows = [
        ("Run", f"{run.name}, seed {experiment.seed}, record SHA-256 {run.digest}"),
        ("Simulation", experiment.label),
        ("Candidate", f"{chosen.candidate} of generation {chosen.generation} (both from 0)"),
        ("Fitness", fitness_words(chosen.fitness, chosen.aggregation)),
        ("Controller", describe_controller(chosen.specification)),
    ]
    return tuple((name, plain(text)) for name, text in rows)


def _parameter_set(run: "Run", chosen: "Choice", facts: tuple[tuple[str, str], ...]) -> Subject:
    from swarmwright.controllers.controller import Controller  # noqa: PLC0415 - loads the engine

    options = run.experiment.controller.model_dump().get("parameters", {})
    options = options if isinstance(options, dict) else {}  # a plug-in may have other options
    ranges = {
        name: f"{shortest_decimal(option['range'][0])} to {shortest_decimal(option['range'][1])}"
        for name, option in options.items()
        if option.get("range") is not None
    }
    values = Controller(chosen.specification).parameters
    return Subject(chosen.specification, facts, values=values, ranges=ranges)


def _load_channels(run: "Run") -> Mapping[str, Any]:
    """Return the stored description of the simulation, see `catalogue.channels`."""
    return run._store.channels() or {}


def _select_channels(channels: Mapping[str, Any], part: Member | None) -> Mapping[str, Any]:
    """Return the sensors and actuators of all agents, or of a group."""
    if part is None:
        return channels
    selected: Mapping[str, Any] = channels.get("groups", {}).get(part.name, channels)
    return selected


def _with_arena_meanings(run: "Run", subject: Subject) -> Subject:
    """Return a subject with the meanings of the arena's sensors and actuators."""
    experiment = run.experiment
    if catalogue.find_built_in(experiment.simulation) != catalogue.ARENA or not subject.description:
        return subject
    robot = robot_in(experiment.parameters)
    meanings = {
        "sensor_meanings": [describe_sensor(sensor.name, robot) for sensor in subject.sensors],
        "actuator_meanings": [describe_actuator(actuator.name, robot) for actuator in subject.actuators],
    }
    return replace(
        subject,
        description={**subject.description, **meanings},
        wheels=(robot.max_speed, robot.wheel_base) if robot.wheel_base else (0.0, 0.0),
    )


def _step_seconds(channels: Mapping[str, Any]) -> float:
    return float(channels.get("step_seconds") or 0.0)


def _record_episodes(run: "Run", chosen: "Choice", part: Member | None, subject: Subject) -> Subject:
    """Return a subject with the simulation's description and recorded episodes."""
    from swarmwright.runs.replay import Replay  # noqa: PLC0415 - needs displays

    parts: list[tuple[NDArray[np.float32], NDArray[np.float32]]] = []
    recorded_steps, count = 0, 0
    for number in range(min(_EPISODES, len(chosen.seeds))):
        replay = Replay.of(run, generation=chosen.generation, candidate=chosen.candidate, episode=number)
        agents, shown_seconds = _record_agents(replay, part)
        recorded_steps += sum(len(sensors) for sensors, _ in agents)
        count += 1
        parts += agents
        if recorded_steps > _STEPS:
            break
    channels = catalogue.channels(replay.experiment.simulation, replay.experiment.parameters)
    specification = subject.specification
    width = (int(specification["sensors"]), int(specification["actuators"]))
    first = np.zeros(recorded_steps, np.bool_)
    starts = np.cumsum([0, *(len(sensors) for sensors, _ in parts)])[:-1]
    first[starts] = True
    sensors, actuators = (
        np.concatenate([np.empty((0, width[side]), np.float32), *(part[side] for part in parts)])
        for side in (0, 1)
    )
    accepted = np.ones(recorded_steps, np.bool_)
    return replace(
        subject,
        description=_select_channels(channels, part),
        episodes=Sequences(
            first,
            sensors,
            actuators,
            accepted,
            find_possible_overflows(specification, first, actuators, accepted),
        ),
        episode_count=count,
        step_size=_step_seconds(channels),
        shown_seconds=shown_seconds,
    )


_Played = list[tuple[NDArray[np.float32], NDArray[np.float32]]]


def _record_agents(replay: Any, part: Member | None) -> tuple[_Played, float]:  # noqa: ANN401 - a Replay
    """Return sensors and actuators of each agent (of a group) in an episode, and the seconds of a step."""
    episode = replay.engine_episode()
    rows = []
    with engine_errors():
        while not episode.done:
            rows.append(episode.step_observed())
    if not rows:
        return [], episode.step_size
    agents, sensors, actuators = (np.concatenate(part) for part in zip(*rows, strict=True))
    if part is not None:
        is_member = (agents >= part.first) & (agents < part.last)
        widths = (int(part.specification["sensors"]), int(part.specification["actuators"]))
        agents, sensors, actuators = (
            agents[is_member],
            sensors[is_member, : widths[0]],
            actuators[is_member, : widths[1]],
        )
    played = [(sensors[agents == agent], actuators[agents == agent]) for agent in np.unique(agents)]
    return played, episode.step_size
