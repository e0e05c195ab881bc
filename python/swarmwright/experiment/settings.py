"""Settings from the command line, KEY.PATH=VALUE, which override an experiment file."""

import copy
import json
import re
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swarmwright import _engine
from swarmwright.common.arguments import mapping, require_list
from swarmwright.common.arguments import text as argument
from swarmwright.common.errors import InputError, SwarmwrightError
from swarmwright.common.problems import format_value
from swarmwright.common.yaml import Path_, Source, format_path, parse
from swarmwright.experiment.budget import LIMITS, sets_limit
from swarmwright.experiment.document import DEFAULT_KINDS
from swarmwright.experiment.misplaced import TOP, iter_right_sections
from swarmwright.experiment.parameter_files import resolve
from swarmwright.experiment.robots import expand_robot, find_kinds_instead, is_part, mission_of
from swarmwright.methods import METHODS
from swarmwright.methods.rankings import RankingOptions
from swarmwright.simulations import catalogue

_PART = re.compile(r'"(?P<quoted>[^"]+)"|(?P<plain>[^.\[\]"=]+)|\[(?P<index>\d+)\]')
SIZES = ("sensors", "actuators")
"""Keys whose announced values may depend on parameters, such as the arena's robot."""
ANNOUNCED = (*SIZES, "requirements")
"""Keys whose announced values depend on the simulation."""
_HINT = "write KEY=VALUE, such as method.generations=50 or 'controller.hidden=[8, 4]'"


@dataclass(frozen=True)
class Setting:
    """A setting."""

    path: tuple[str, ...]
    value: Any
    text: str
    """The text with the option's name, for messages."""

    @property
    def is_base(self) -> bool:
        """Whether other settings depend on it: a kind, or the simulation."""
        kind = len(self.path) == 2 and self.path[0] in DEFAULT_KINDS and self.path[1] == "kind"
        return kind or self.path == ("simulation",)


def parse_settings(texts: Iterable[str | Setting]) -> list[Setting]:
    """Parse settings such as `method.generations=50`; the values are YAML. Parsed settings stay.

    Raises InputError with all problems, one per line.
    """
    require_list("settings", texts, "settings such as method.generations=50")
    settings, problems = [], []
    for item in texts:
        if isinstance(item, Setting):
            settings.append(item)
            continue
        text = argument("settings", item, "a list of texts such as method.generations=50")
        try:
            settings.append(_parse_setting(text))
        except InputError as error:
            problems.append(f"--set {text}: {error}")
    if problems:
        raise InputError("\n".join(problems))
    return settings


def parameter_settings(parameters: Mapping[str, Any]) -> list[Setting]:
    """Return settings that give other values to parameters of the simulation.

    parameters: JSON values by key: `robots`, or `robot.drive.noise` for a part of one. Raises InputError for
    other keys and values, and for the seed, since every episode has its own.
    """
    settings = []
    for key, value in mapping("parameters", parameters, "{'robots': 40}").items():
        name = argument("parameters", key, "names of parameters such as 'robots'")
        try:
            path, rest = key_path(f"{name}=")
            if rest:
                raise InputError(_HINT)
            plain = json.loads(json.dumps(value, allow_nan=False))
        except InputError:
            raise InputError(f"parameters: {name!r} is not the name of a parameter") from None
        except (TypeError, ValueError):
            raise InputError(f"parameters.{name}: {value!r} found, expected a JSON value") from None
        if path == ("seed",):
            raise InputError("parameters.seed: has no effect here; each episode has its own seed")
        settings.append(Setting(("parameters", *path), plain, f"parameters.{name}"))
    return settings


def key_path(text: str) -> tuple[tuple[str, ...], str]:
    """Split `KEY.PATH=VALUE` into the parts of the key and the text of the value. Raises InputError."""
    path: list[str] = []
    at = 0
    while match := _PART.match(text, at):
        path.append(match["quoted"] or match["plain"] or match["index"])
        at = match.end()
        if not text.startswith(".", at):
            if text.startswith("[", at):
                continue
            break
        at += 1
    if not path or not text.startswith("=", at):
        raise InputError(_HINT)
    return tuple(path), text[at + 1 :]


def _parse_setting(text: str) -> Setting:
    path, value = key_path(text)
    try:
        source = parse(value, "")
    except InputError as error:
        raise InputError(re.sub(r"^:(\d+:)? *", "the value ", str(error))) from error
    for _, _, message in source.problems:
        raise InputError(f"the value is not plain YAML: {message}")
    return Setting(path, source.values, f"--set {text}")


def check_allowed(
    settings: Iterable[Setting], keys: Collection[str], reason: str, values: Mapping[str, Any], *, ask: bool
) -> None:
    """Raise InputError for settings of keys that are not allowed, one line each.

    Args:
        settings: to check.
        keys: the allowed keys.
        reason: why other keys are not allowed, the end of a sentence.
        values: the experiment's values.
        ask: whether the class of a simulation may be imported, to find its parameters.
    """
    problems = []
    for setting in settings:
        key = setting.path[0]
        if key in keys:
            continue
        parameters = {*values["parameters"]}
        with suppress(SwarmwrightError):  # not available here
            parameters |= {*catalogue.parameter_names(values["simulation"])} if ask else set()
        sections = [] if key in TOP else [*iter_right_sections(key, "", values, parameters)]
        belongs = f"unknown key; it belongs to another section: {' or '.join(sections)}"
        problems.append(f"{setting.text}: {belongs if sections else f'{key}: {reason}'}")
    if problems:
        raise InputError("\n".join(problems))


def refuse_seed(texts: Iterable[str | Setting]) -> None:
    """Raise InputError for settings of a seed, for which there is a separate option."""
    for setting in parse_settings(texts):
        if setting.path in {("seed",), ("parameters", "seed")}:
            raise InputError(f"{setting.text}: has no effect here; set the seed of episodes with --seed")


def apply(source: Source, settings: Iterable[Setting], *, new_budget: bool = True) -> Source:
    """Apply settings to the values of a file; see `Experiment.load`.

    Settings that cannot be applied are added to the source's problems.

    Args:
        source: source of the file.
        settings: to apply.
        new_budget: whether a new limit replaces all limits of the file.
    """
    ordered = _sort(settings)
    if not ordered or not isinstance(source.values, Mapping | None):
        return source
    values = copy.deepcopy(dict(source.values or {}))
    paths = [setting.path for setting in ordered if not _is_count(setting)]

    def folder(path: Path_) -> Path:
        return source.folder(("parameters", *path))

    kinds = find_kinds_instead(values, paths, folder)
    changed = Source(
        source.name,
        expand_robot(values, paths, folder),
        dict(source.lines),
        list(source.problems),
        dict(source.options),
    )
    if new_budget:
        _drop_limits(changed, ordered)
    for setting in ordered:
        if setting.path[1:] == ("kind",) and setting.is_base:
            _reset_section(changed, setting)
        elif setting.is_base:
            _drop_announced(changed, setting)
        if kinds is not None and is_part(setting.path):
            example = ".".join((f"{kinds}.0.robot", *setting.path[2:]))
            _report(
                changed,
                setting,
                setting.path[:2],
                f"has no effect, as there are kinds of robots; set a component of a kind, such as {example}",
            )
            continue
        _assign(changed, setting)
    return changed


def _is_count(setting: Setting) -> bool:
    """Return whether a setting says how many robots there are, but not which ones."""
    return setting.path[-1] == "robots" and isinstance(setting.value, int)


def _sort(settings: Iterable[Setting]) -> list[Setting]:
    """Sort settings so that those on which others depend come first, but after their whole section."""
    ordered: list[Setting] = []
    for setting in settings:
        position = len(ordered)
        if setting.is_base:
            wholes = [
                index
                for index, previous in enumerate(ordered)
                if previous.path in {setting.path, setting.path[:1]}
            ]
            position = wholes[-1] + 1 if wholes else 0
        ordered.insert(position, setting)
    return ordered


def _drop_limits(source: Source, settings: Iterable[Setting]) -> None:
    """Drop the limits of the file if settings have a limit."""
    has_limit = sets_limit(
        {
            setting.path[1]: setting.value
            for setting in settings
            if len(setting.path) == 2 and setting.path[0] == "method"
        }
    )
    method = source.values.get("method")
    if has_limit and isinstance(method, dict):
        for name in LIMITS:
            method.pop(name, None)
            _forget(source, ("method", name))


def _reset_section(source: Source, setting: Setting) -> None:
    """Drop the options of a section whose kind changes, see `kept_options`."""
    section = setting.path[0]
    new = setting.value or DEFAULT_KINDS[section]
    old = source.values.get(section)
    kind = old.get("kind", DEFAULT_KINDS[section]) if isinstance(old, Mapping) else DEFAULT_KINDS[section]
    if new != kind or not isinstance(old, Mapping):
        names = list_kept_options(section, new) if isinstance(old, Mapping) else []
        options = {name: old[name] for name in names if name in old}
        source.values[section] = options
        _forget(source, (section,), but=[(section,), *((section, name) for name in options)])


def list_kept_options(section: str, kind: Any) -> list[str]:  # noqa: ANN401 - any value of a file
    """Return the options that a section keeps when its kind changes.

    These are the budget and the target of methods, and the common options of rankings; other options of the
    same name belong to the old kind.
    """
    if section == "ranking":
        return [name for name in RankingOptions.model_fields if name != "kind"]
    if section != "method":
        return []
    try:
        # A class in a file is imported later, when the options are checked.
        is_known = isinstance(kind, str) and not METHODS.is_in_file(kind)
        race = METHODS.get(kind).by_instance if is_known else False
    except InputError:  # reported when the options are checked
        return []
    # In a race a generation is an instance, so their number is no budget.
    return ["target", *(name for name in LIMITS if not (race and name == "generations"))]


def _drop_announced(source: Source, setting: Setting) -> None:
    """Drop values that the new simulation announces itself."""
    if setting.value == source.values.get("simulation") or not isinstance(setting.value, str):
        return
    if catalogue.has_description(setting.value):
        for name in ANNOUNCED:
            source.values.pop(name, None)
            _forget(source, (name,))


def assign(values: dict[str, Any], path: tuple[str, ...], value: Any) -> None:  # noqa: ANN401 - as in a file
    """Set a value at a path, as `--set` does. Raises InputError if that is not possible.

    Args:
        values: values of an experiment, with its `simulation`; changed in place.
        path: keys and numbers of items.
        value: None resets the key to its default.
    """
    source = Source("", values)
    _assign(source, Setting(path, value, format_path(path)))
    if source.problems:
        raise InputError("\n".join(message for _, _, message in source.problems))


def _assign(source: Source, setting: Setting) -> None:
    container: Any = source.values
    path: Path_ = ()
    for index, part in enumerate(setting.path):
        last = index + 1 == len(setting.path)
        key: str | int = part
        if isinstance(container, list):
            if not part.isdecimal() or int(part) >= len(container):
                count = len(container)
                numbers = f"its items are 0 to {count - 1}" if count else "it is empty"
                _report(source, setting, path, f"is a list without an item {part!r}; {numbers}")
                return
            key = int(part)
        elif not isinstance(container, dict):
            _report(source, setting, path, f"is {format_value(container)}, which has no key {part!r}")
            return
        path = (*path, key)
        if last and setting.value is None and isinstance(container, dict):
            container.pop(key, None)
        elif last:
            container[key] = copy.deepcopy(setting.value)
        else:
            if isinstance(container, dict) and container.get(part) is None:
                if path[0] != "parameters" and setting.path[index + 1].isdecimal():
                    number, whole = setting.path[index + 1], format_path(path)
                    _report(
                        source, setting, path, f"is not set, so it has no item {number}; set {whole}=[..]"
                    )
                    return
                container[part] = {}
            if isinstance(container[key], str):
                container[key] = _expand(source, path, container[key])
            container = container[key]
    _forget(source, path)
    source.options[path] = setting.text


def _expand(source: Source, path: Path_, name: str) -> Any:  # noqa: ANN401 - any parameter
    """Expand a parameter given by name, a file or a mission, so that its components can be set."""
    simulation = source.values.get("simulation")
    if path[:1] != ("parameters",) or not isinstance(simulation, str):
        return name
    if catalogue.find_built_in(simulation) is None:
        return name
    if len(path) != 2:
        of_kind = path[-1] == "robot" and path[1] in {"mission", "robots"}
        return {"preset": name} if of_kind and name in _engine.robots() else name
    parameter = str(path[1])
    invalid: list[Path_] = []
    resolved, _ = resolve(
        simulation,
        {parameter: name},
        lambda _: source.folder(path),
        lambda problem_path, _: invalid.append(problem_path),
        ask=False,
    )
    if invalid:  # reported when the experiment is checked
        return name
    if parameter == "mission" and catalogue.find_built_in(simulation) == catalogue.ARENA:
        return mission_of(resolved[parameter]) or name
    return resolved[parameter]


def _report(source: Source, setting: Setting, path: Path_, message: str) -> None:
    # A separate path, as the file's own value at this path is checked as well.
    key: Path_ = (*path, setting.text)
    source.options[key] = setting.text
    source.problems.append((key, 0, f"{format_path(path)} {message}"))


def _forget(source: Source, path: Path_, *, but: Collection[Path_] = ()) -> None:
    """Forget the origin of the values at and below a path."""
    for origins in (source.lines, source.options):
        for origin in [part for part in origins if part[: len(path)] == path and part not in but]:
            del origins[origin]
