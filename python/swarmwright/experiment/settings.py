"""Settings from the command line, KEY.PATH=VALUE: what is otherwise than an experiment file says."""

import copy
import re
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swarmwright import _engine
from swarmwright.common.arguments import require_list
from swarmwright.common.arguments import text as argument
from swarmwright.common.errors import InputError, SwarmwrightError
from swarmwright.common.problems import format_value
from swarmwright.common.yaml import Path_, Source, format_path, parse
from swarmwright.experiment.budget import LIMITS, sets_limit
from swarmwright.experiment.document import DEFAULT_KINDS
from swarmwright.experiment.misplaced import TOP, right_places
from swarmwright.experiment.parameter_files import resolve
from swarmwright.experiment.robots import is_part, kinds_instead, mission_of, written_out
from swarmwright.methods import METHODS
from swarmwright.methods.rankings import RankingOptions
from swarmwright.simulations import catalogue

_PART = re.compile(r'"(?P<quoted>[^"]+)"|(?P<plain>[^.\[\]"=]+)|\[(?P<index>\d+)\]')
SIZES = ("sensors", "actuators")
"""What parameters of a simulation, such as the arena's robot, may announce differently."""
ANNOUNCED = (*SIZES, "requirements")
"""What another simulation announces differently."""
_HINT = "write KEY=VALUE, such as method.generations=50 or 'controller.hidden=[8, 4]'"


@dataclass(frozen=True)
class Setting:
    """One value that is set."""

    path: tuple[str, ...]
    value: Any
    text: str
    """As it was given, with the option's name: what messages begin with."""

    @property
    def first(self) -> bool:
        """Whether other settings build on it: a kind, or the simulation."""
        kind = len(self.path) == 2 and self.path[0] in DEFAULT_KINDS and self.path[1] == "kind"
        return kind or self.path == ("simulation",)


def parse_settings(texts: Iterable[str]) -> list[Setting]:
    """Read settings such as `method.generations=50`; the values are YAML.

    Raises InputError with all that cannot be read, a line each.
    """
    require_list("settings", texts, "settings such as method.generations=50")
    settings, problems = [], []
    for given_text in texts:
        text = argument("settings", given_text, "a list of texts such as method.generations=50")
        try:
            settings.append(_setting(text))
        except InputError as error:
            problems.append(f"--set {text}: {error}")
    if problems:
        raise InputError("\n".join(problems))
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


def _setting(text: str) -> Setting:
    path, value = key_path(text)
    try:
        source = parse(value, "")
    except InputError as error:
        raise InputError(re.sub(r"^:(\d+:)? *", "the value ", str(error))) from error
    for _, _, message in source.problems:
        raise InputError(f"the value is not plain YAML: {message}")
    return Setting(path, source.values, f"--set {text}")


def restricted(
    settings: Iterable[Setting], keys: Collection[str], reason: str, values: Mapping[str, Any], *, ask: bool
) -> None:
    """Raise InputError for settings of other keys than these, a line each.

    Args:
        settings: what is set.
        keys: what may be set.
        reason: why no others, the end of a sentence.
        values: all of the experiment.
        ask: whether a simulation that is named by its class may be imported, to be asked for its parameters.
    """
    problems = []
    for setting in settings:
        key = setting.path[0]
        if key in keys:
            continue
        known = {*values["parameters"]}
        with suppress(SwarmwrightError):  # it is not here
            known |= {*catalogue.parameter_names(values["simulation"])} if ask else set()
        found = [] if key in TOP else [*right_places(key, "", values, known)]
        belongs = f"unknown key; it belongs to another section: {' or '.join(found)}"
        problems.append(f"{setting.text}: {belongs if found else f'{key}: {reason}'}")
    if problems:
        raise InputError("\n".join(problems))


def refuse_seed(texts: Iterable[str]) -> None:
    """Raise InputError where a seed is set, the method's or that of episodes, which another option names."""
    for setting in parse_settings(texts):
        if setting.path in {("seed",), ("parameters", "seed")}:
            raise InputError(f"{setting.text}: has no effect here; the seed of episodes is the option --seed")


def apply(source: Source, settings: Iterable[Setting], *, new_budget: bool = True) -> Source:
    """Return what a file says with settings in the place of its own values; see `Experiment.load`.

    What cannot be set is noted among the source's problems.

    Args:
        source: what the file says.
        settings: what is set.
        new_budget: whether a limit that is set takes the place of all limits of the file.
    """
    ordered = _in_order(settings)
    if not ordered or not isinstance(source.values, Mapping | None):
        return source
    values, paths = copy.deepcopy(dict(source.values or {})), [assignment.path for assignment in ordered]

    def folder(path: Path_) -> Path:
        return source.folder(("parameters", *path))

    kinds = kinds_instead(values, paths, folder)
    changed = Source(
        source.name,
        written_out(values, paths, folder),
        dict(source.lines),
        list(source.problems),
        dict(source.options),
    )
    if new_budget:
        _drop_limits(changed, ordered)
    for setting in ordered:
        if setting.path[1:] == ("kind",) and setting.first:
            _start_anew(changed, setting)
        elif setting.first:
            _other_simulation(changed, setting)
        if kinds is not None and is_part(setting.path):
            example = ".".join((f"{kinds}.0.robot", *setting.path[2:]))
            _complain(
                changed,
                setting,
                setting.path[:2],
                f"is not used here: there are kinds of robots; set what belongs to one, such as {example}",
            )
            continue
        _assign(changed, setting)
    return changed


def _in_order(settings: Iterable[Setting]) -> list[Setting]:
    """Return settings with those first on which others build, but after the whole section given before."""
    ordered: list[Setting] = []
    for setting in settings:
        place = len(ordered)
        if setting.first:
            wholes = [
                index for index, other in enumerate(ordered) if other.path in {setting.path, setting.path[:1]}
            ]
            place = wholes[-1] + 1 if wholes else 0
        ordered.insert(place, setting)
    return ordered


def _drop_limits(source: Source, settings: Iterable[Setting]) -> None:
    """Drop the limits of the file where settings have one, so that it means the same for any file."""
    given = sets_limit(
        {
            setting.path[1]: setting.value
            for setting in settings
            if len(setting.path) == 2 and setting.path[0] == "method"
        }
    )
    method = source.values.get("method")
    if given and isinstance(method, dict):
        for name in LIMITS:
            method.pop(name, None)
            _forget(source, ("method", name))


def _start_anew(source: Source, setting: Setting) -> None:
    """Drop the options of a section that gets another kind, see `kept_options`."""
    section = setting.path[0]
    new = setting.value or DEFAULT_KINDS[section]
    old = source.values.get(section)
    kind = old.get("kind", DEFAULT_KINDS[section]) if isinstance(old, Mapping) else DEFAULT_KINDS[section]
    if new != kind or not isinstance(old, Mapping):
        names = kept_options(section, new) if isinstance(old, Mapping) else []
        kept = {name: old[name] for name in names if name in old}
        source.values[section] = kept
        _forget(source, (section,), but=[(section,), *((section, name) for name in kept)])


def kept_options(section: str, kind: Any) -> list[str]:  # noqa: ANN401 - any value of a file
    """Return the options of a file's section that are kept where it gets another kind: they mean the same.

    A budget and a target are kept, and what all rankings have; other options are another kind's, even those
    of the same name.
    """
    if section == "ranking":
        return [name for name in RankingOptions.model_fields if name != "kind"]
    if section != "method":
        return []
    try:
        # A class in a file is imported when the options are checked, from the folder that it is named in.
        asked = isinstance(kind, str) and not METHODS.is_in_file(kind)
        race = METHODS.get(kind).by_instance if asked else False
    except InputError:  # is reported when the options are checked
        return []
    # A generation of a race is one instance, and their number no budget.
    return ["target", *(name for name in LIMITS if not (race and name == "generations"))]


def _other_simulation(source: Source, setting: Setting) -> None:
    """Drop what the file says that its own simulation announces, where the other one can be asked itself."""
    if setting.value == source.values.get("simulation") or not isinstance(setting.value, str):
        return
    if catalogue.has_description(setting.value):
        for name in ANNOUNCED:
            source.values.pop(name, None)
            _forget(source, (name,))


def assign(values: dict[str, Any], path: tuple[str, ...], value: Any) -> None:  # noqa: ANN401 - as in a file
    """Set what is at a path below the first key, as `--set` does. Raises InputError where it cannot be set.

    Args:
        values: of an experiment, with its `simulation`; they are changed.
        path: keys and numbers of items.
        value: None takes the key back to its default.
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
                _complain(source, setting, path, f"is a list, which has no item {part!r}; {numbers}")
                return
            key = int(part)
        elif not isinstance(container, dict):
            _complain(source, setting, path, f"is {format_value(container)}, which has no part {part!r}")
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
                    _complain(
                        source, setting, path, f"is not given, so there is no item {number}; set {whole}=[..]"
                    )
                    return
                container[part] = {}
            if isinstance(container[key], str):
                container[key] = _with_parts(source, path, container[key])
            container = container[key]
    _forget(source, path)
    source.options[path] = setting.text


def _with_parts(source: Source, path: Path_, name: str) -> Any:  # noqa: ANN401 - any parameter
    """Return a parameter whose parts are to be set: what is in the file, or of the mission, that it names."""
    simulation = source.values.get("simulation")
    if path[:1] != ("parameters",) or not isinstance(simulation, str):
        return name
    if catalogue.find_built_in(simulation) is None:
        return name
    if len(path) != 2:
        of_kind = path[-1] == "robot" and path[1] in {"mission", "robots"}
        return {"preset": name} if of_kind and name in _engine.robots() else name
    parameter = str(path[1])
    wrong: list[Path_] = []
    found, _ = resolve(
        simulation,
        {parameter: name},
        lambda _: source.folder(path),
        lambda place, _: wrong.append(place),
        ask=False,
    )
    if wrong:  # reported when the experiment is checked
        return name
    if parameter == "mission" and catalogue.find_built_in(simulation) == catalogue.ARENA:
        return mission_of(found[parameter]) or name
    return found[parameter]


def _complain(source: Source, setting: Setting, path: Path_, message: str) -> None:
    # A place of its own: what the file itself has at this path is checked as well.
    place: Path_ = (*path, setting.text)
    source.options[place] = setting.text
    source.problems.append((place, 0, f"{format_path(path)} {message}"))


def _forget(source: Source, path: Path_, *, but: Collection[Path_] = ()) -> None:
    """Forget where the values at and below a path came from."""
    for places in (source.lines, source.options):
        for place in [part for part in places if part[: len(path)] == path and part not in but]:
            del places[place]
