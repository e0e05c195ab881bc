"""What is wrong with a definition of robots of a ROS system beyond the form of each key."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarmwright.common.suggestions import did_you_mean
from swarmwright.common.yaml import Path_, dotted_path
from swarmwright.simulations.command.ros_sections import GET_ENTITIES_STATES, RESET_SIMULATION, SPAWN_ENTITY
from swarmwright.simulations.ros.fields import READERS, STATES, WRITERS, SameFieldError, reader, writers
from swarmwright.simulations.ros.mapping import MappingError, choice, read_mapping, short_type
from swarmwright.simulations.ros.names import resolve

if TYPE_CHECKING:
    from swarmwright.simulations.command.ros_definition import RosOptions


def problems(options: "RosOptions") -> list[tuple[Path_, str]]:
    """Return problems, with the keys."""
    return [*_of_topics(options), *_of_metrics(options), *_of_others(options)]


def _of_topics(options: "RosOptions") -> Iterator[tuple[Path_, str]]:
    for key, entries, name in (
        ("sensors", options.sensors, "sensor"),
        ("actuators", options.actuators, "actuator"),
    ):
        names: list[str] = []
        for index, entry in enumerate(entries):
            path: Path_ = (key, index)
            own: str = getattr(entry, name)
            if own in names:
                yield (*path, name), f"{own} is there twice; each needs a name of its own"
            names.append(own)
            yield from _problem(entry.model_dump(exclude_defaults=True), key, path)
    if bool(options.sensors) != bool(options.actuators):
        missing = "sensors" if options.actuators else "actuators"
        yield (missing,), "is missing: controllers need sensors and actuators"
    yield from _types(options)
    own_names = [one.actuator for one in options.actuators]
    block = {"rate": 1, "sensors": [], "actuators": options.topics["actuators"]}
    try:
        actuators = read_mapping(block, [], own_names).actuators
        for topic in dict.fromkeys(one.place.topic for one in actuators):
            writers([one for one in actuators if one.place.topic == topic])
    except SameFieldError as error:
        yield ("actuators", error.actuator.terms[0][0]), error.reason
    except MappingError:
        pass  # of one entry, which is told of above


def _types(options: "RosOptions") -> Iterator[tuple[Path_, str]]:
    """A topic has one type."""
    types: dict[str, tuple[str, str]] = {}
    places: list[tuple[Path_, Any]] = [(("sensors", index), one) for index, one in enumerate(options.sensors)]
    places += [(("actuators", index), one) for index, one in enumerate(options.actuators)]
    places += [(("metrics", name), one) for name, one in options.metrics.items() if one.topic]
    for path, one in places:
        wrong = _of_topic(one.topic)
        if wrong is not None:
            yield (
                (*path, "topic"),
                f"{one.topic!r} is not a topic: {wrong}; expected such as scan or /robot_1/scan",
            )
            continue
        if "{robot}" in one.topic and "/" in options.robots:
            yield (*path, "topic"), "{robot} needs robots with names; write robots: [NAME, ..]"
        other, where = types.setdefault(one.topic, (short_type(one.type), dotted_path(path)))
        if other != short_type(one.type):
            yield (*path, "type"), f"{one.topic} has the type {other} at {where}; a topic has one type"


def _of_topic(topic: str) -> str | None:
    """Return why a topic is none, which may hold `{robot}`; None for one."""
    if topic.startswith("~"):
        return "names that are private to a node are not supported"
    try:
        resolve(topic.replace("{robot}", "robot"))
    except ValueError as error:
        return str(error)
    return None


def _of_metrics(options: "RosOptions") -> Iterator[tuple[Path_, str]]:
    sensors = [one.sensor for one in options.sensors]
    for name, metric in options.metrics.items():
        path: Path_ = ("metrics", name)
        if metric.sensor is not None:
            if metric.sensor not in sensors:
                there = f"; available: {', '.join(sensors) or 'none'}"
                hint = did_you_mean(metric.sensor, sensors) or there
                yield (*path, "sensor"), f"there is no sensor {metric.sensor!r}{hint}"
        elif metric.type == GET_ENTITIES_STATES:
            if options.ros == 1:
                yield (*path, "type"), "simulation_interfaces are of ROS 2"
            if metric.field not in STATES:
                hint = did_you_mean(metric.field or "", STATES) or f"; available: {', '.join(STATES)}"
                yield (*path, "field"), f"{metric.field!r} is not a field of an entity's state{hint}"
        else:
            yield from _problem({**metric.place, "sensor": name}, "sensors", path)


def _of_others(options: "RosOptions") -> Iterator[tuple[Path_, str]]:
    for key, of in (("step", options.step), ("reset", options.reset)):
        if options.ros == 1 and (of.type or "").startswith("simulation_interfaces"):
            yield (key, "type"), f"{of.type} is of ROS 2"
    if options.reset.type != RESET_SIMULATION and options.reset.scope != ["default"]:
        yield ("reset", "scope"), f"only {RESET_SIMULATION} has it; write type: {RESET_SIMULATION}"
    if options.spawn is not None:
        if options.ros == 1:
            yield ("spawn",), f"{SPAWN_ENTITY} is of ROS 2"
        if options.spawn.poses and len(options.spawn.poses) != len(options.robots):
            count, poses = len(options.robots), len(options.spawn.poses)
            yield ("spawn", "poses"), f"must have a pose of each of the {count} robots, not {poses}"
        if options.spawn.file is not None and not (Path(options.folder) / options.spawn.file).is_file():
            yield ("spawn", "file"), f"{options.spawn.file}: there is no such file"
        elif options.spawn.file is not None:
            try:
                (Path(options.folder) / options.spawn.file).read_text("utf-8")
            except OSError as error:
                yield ("spawn", "file"), f"{options.spawn.file}: cannot be read: {error.strerror}"
            except UnicodeDecodeError:
                yield ("spawn", "file"), f"{options.spawn.file}: is not UTF-8 text, as a model in SDF or URDF"


def _problem(entry: Mapping[str, Any], key: str, path: Path_) -> Iterator[tuple[Path_, str]]:
    """Check one entry as the program reads it."""
    name = "sensor" if key == "sensors" else "actuator"
    known = READERS if key == "sensors" else WRITERS
    if short_type(entry["type"]) not in known:
        yield (*path, "type"), f"{entry['type']!r} is not known here; expected {choice(list(known))}"
        return
    other = {"sensors": "actuators", "actuators": "sensors"}[key]
    try:
        mapping = read_mapping({"rate": 1, key: [dict(entry)], other: []},
                               [entry[name]] if name == "sensor" else [],
                               [entry[name]] if name == "actuator" else [])  # fmt: skip
        if key == "sensors":
            reader(mapping.sensors[0])
        else:
            writers(mapping.actuators)
    except MappingError as error:
        if not error.key:
            yield path, error.reason
        else:
            message = error.reason.removeprefix(f"{error.key}:").removeprefix(f"{error.key} ")
            yield (*path, error.key), message.strip()
