"""Conversion of a file's values to checked options, with the positions of all problems."""

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from swarmwright.common.errors import InputError, SwarmwrightError
from swarmwright.common.problems import Report, format_value
from swarmwright.common.simulation_names import LIBRARIES, definition_in, is_definition, is_in_file, is_python
from swarmwright.common.yaml import Path_, Source
from swarmwright.controllers.kinds.parameter_set import irace
from swarmwright.experiment import competition
from swarmwright.experiment.checks import check_values
from swarmwright.experiment.document import DEFAULT_KINDS, STORE, Checked
from swarmwright.experiment.launcher_entries import entries_of, names_launchers
from swarmwright.experiment.misplaced import with_right_section
from swarmwright.experiment.opponents import load_opponent
from swarmwright.experiment.parameter_files import is_mission, resolve
from swarmwright.experiment.start_from import read_entries
from swarmwright.experiment.unavailable import UnavailableMethod, UnreadRanking
from swarmwright.methods.plug_ins import REGISTRIES
from swarmwright.methods.rankings.tournament import MOST_OPPONENTS
from swarmwright.simulations import catalogue
from swarmwright.simulations.names import make_absolute, resolve_run_name
from swarmwright.simulations.user_code import permission


def check(
    source: Source,
    *,
    ask: bool = True,
    folder: Path | None = None,
    lenient: Collection[str] = (),
) -> Checked:
    """Check the values of a file or mapping.

    Args:
        source: the file.
        ask: whether the class of a simulation may be imported.
        folder: base of relative paths; default: the folder of the file.
        lenient: sections that may be unavailable, for a run that is only read: a method that is not
        installed,
            or a method or ranking in a file.

    Raises InputError with all problems, one per line, in the order of the file.
    """
    problems = [(path, line, message) for path, line, message in source.problems]

    def report(path: Path_, message: str) -> None:
        problems.append((path, 0, message))

    checked: Checked = {}
    if not isinstance(source.values, Mapping):
        content = "is empty" if source.values is None else f"holds {format_value(source.values)}"
        begins = "an experiment is a mapping such as 'simulation: minisim'"
        report((), f"{content}; {begins}{_suggest_import(source)}")
    elif "experiment" in source.values and "simulation" not in source.values:
        report((), "is a sweep file, not an experiment; run it with 'swarmwright sweep'")
    elif is_mission(source.values):
        report((), _NO_EXPERIMENT.format(source.name or "FILE.yaml"))
    else:
        # An empty section ("method:") has its defaults.
        values = {key: value for key, value in source.values.items() if not (value is None and key in _EMPTY)}
        is_available = _with_simulation(values, folder or source.folder(("simulation",)), report, ask=ask)
        values, files, unread = _with_files(source, values, report, ask=is_available)
        values = _with_controllers(source, values, report)
        values = _with_opponents(source, values, report)
        values = _with_modules(source, values, folder, report)
        values, report_set = _with_parameter_file(source, values, report)
        values = _with_classes(source, values, folder, report, ask=ask)
        values = _with_launchers(source, values, folder, report)
        values, report_side = competition.expand(values, is_available, report_set)
        placed = _report_in_sections(values, is_available, _report_in_files(files, report_side))
        with _use_stand_ins({"method", "ranking"} if not ask else lenient):
            checked = check_values(values, is_available, placed, ask=ask, unread=unread)
        if ask and "method" not in lenient and checked.get("method") is not None:  # not needed to read a run
            missing = REGISTRIES["method"].get(checked["method"].kind).missing()
            if missing is not None:
                report(("method", "kind"), missing)
    if problems:
        broken = {path for path, line, _ in problems if line}
        lines = [
            ((0, line) if line else source.order(path), _format_problem(source, path, line, message))
            for path, line, message in problems
            # Do not report problems within duplicate keys.
            if line or path not in broken
        ]
        raise InputError("\n".join(text for _, text in sorted(lines, key=lambda entry: entry[0])))
    return checked


@contextmanager
def _use_stand_ins(sections: Collection[str]) -> Iterator[None]:
    """Allow unavailable sections within the block, without importing from files."""
    with ExitStack() as stack:
        if "method" in sections:
            stack.enter_context(REGISTRIES["method"].lenient(UnavailableMethod))
            stack.enter_context(REGISTRIES["method"].unread(UnavailableMethod))
        if "ranking" in sections:
            stack.enter_context(REGISTRIES["ranking"].unread(UnreadRanking))
        yield


_NO_EXPERIMENT = (
    "is a mission, not an experiment; use it as parameters: {{mission: {}}} with simulation: arena, as "
    "printed by 'swarmwright new arena'"
)
_EMPTY = frozenset({*DEFAULT_KINDS, "parameters", "constraints", "validate", "timeouts", "faults"})


def _suggest_import(source: Source) -> str:
    """Return a hint for files that may be a FREVO session or a drawn model."""
    if not str(source.values).startswith("<"):
        return ""
    return "; convert a FREVO session or a drawn model with 'swarmwright import'"


def _format_problem(source: Source, path: Path_, line: int, message: str) -> str:
    if not line:
        return source.locate(path) + message
    return Source(source.name, lines={path: line}).locate(path) + message


def _with_simulation(values: dict[str, Any], folder: Path, report: Report, *, ask: bool) -> bool:
    """Resolve a simulation's file relative to the experiment; return whether it can be asked."""
    simulation = values.get("simulation")
    if isinstance(simulation, str) and simulation.endswith((".fmu", ".ssp")):
        simulation = {"fmu": simulation}
    if isinstance(simulation, str) and is_definition(simulation):
        try:
            simulation = definition_in(simulation)
        except InputError as error:
            report(("simulation",), str(error))
            return False
    if isinstance(simulation, Mapping) and not {*LIBRARIES}.isdisjoint(simulation):
        library, name = next(
            (known_library, simulation[known_library])
            for known_library in LIBRARIES
            if known_library in simulation
        )
        written = f"{library}:{name or 'NAME'}"
        report(("simulation",), f"environments are written without a space; write {written}")
        values["simulation"] = written
        return False
    if isinstance(simulation, Mapping):
        from swarmwright.experiment import commands  # noqa: PLC0415 - only where there is a command

        simulation = values["simulation"] = commands.name_of(
            simulation, values, None if (folder / STORE).exists() else folder, report
        )
        ask = ask and simulation != commands.INVALID
    if not isinstance(simulation, str):
        return False
    if not is_python(simulation):
        return catalogue.find_built_in(simulation) is not None
    find = resolve_run_name if (folder / STORE).exists() else make_absolute
    values["simulation"] = find(simulation, folder)
    if ask:
        try:
            catalogue.description(values["simulation"])
        except SwarmwrightError as error:
            report(("simulation",), str(error))
            return False
    return ask


def _report_in_files(files: Mapping[Path_, Source], report: Report) -> Report:
    """Wrap a report to add file and line of values in parameters' files.

    files: by the path of the value that they replace, from the parameter's name on.
    """

    def report_in_file(path: Path_, message: str) -> None:
        value_path = path[1:] if path[:1] == ("parameters",) else ()
        # From the inside out, as a mission's file may contain a robot's file.
        for length in range(len(value_path), 0, -1):
            if value_path[:length] in files:
                message = files[value_path[:length]].locate(value_path[length:]) + message
                value_path = value_path[:length]
        report((*path[:1], *value_path) if value_path else path, message)

    return report_in_file


def _report_in_sections(values: Mapping[str, Any], is_available: bool, report: Report) -> Report:
    """Wrap a report to add the right section of misplaced keys."""

    def report_in_section(path: Path_, message: str) -> None:
        if path and len(path) <= 2 and isinstance(path[-1], str):
            parameters = catalogue.parameter_names(values["simulation"]) if is_available else ()
            section = str(path[0]) if len(path) == 2 else ""
            message = with_right_section(message, path[-1], section, values, parameters)
        report(path, message)

    return report_in_section


def _with_files(
    source: Source, values: dict[str, Any], report: Report, *, ask: bool
) -> tuple[dict[str, Any], dict[Path_, Source], bool]:
    """Replace parameters' files; return the values, the files, and whether any is unreadable."""
    simulation, parameters = values.get("simulation"), values.get("parameters")
    if not isinstance(simulation, str) or not isinstance(parameters, Mapping):
        return values, {}, False
    resolved, files = resolve(
        simulation,
        parameters,
        lambda path: source.folder(("parameters", *path)),
        lambda path, message: report(("parameters", *path), message),
        ask=ask,
    )
    return {**values, "parameters": resolved}, files, len(resolved) < len(parameters)


def _with_controllers(source: Source, values: dict[str, Any], report: Report) -> dict[str, Any]:
    """Replace the paths of `start_from` by the controllers."""
    if values.get("start_from") is None:
        return values
    try:
        return {**values, "start_from": read_entries(values["start_from"], source.folder(("start_from",)))}
    except SwarmwrightError as error:
        report(("start_from",), str(error))
        return {**values, "start_from": None}


def _with_opponents(source: Source, values: dict[str, Any], report: Report) -> dict[str, Any]:
    """Replace the paths of `ranking.opponents` by the controllers, those that cannot be read by {}."""
    ranking = values.get("ranking")
    opponents = ranking.get("opponents") if isinstance(ranking, Mapping) else None
    if not isinstance(ranking, Mapping) or not opponents:
        return values
    key: Path_ = ("ranking", "opponents")

    def read(entries: Any, path: Path_) -> Any:  # noqa: ANN401 - whatever the file says
        if not isinstance(entries, list | tuple) or len(entries) > MOST_OPPONENTS:
            return entries  # is reported with the ranking's options
        controllers = []
        for number, entry in enumerate(entries):
            try:
                controllers.append(load_opponent(entry, source.folder((*path, number))).to_mapping())
            except SwarmwrightError as error:
                report((*path, number), str(error))
                controllers.append({})
        return controllers

    if isinstance(opponents, Mapping):
        opponents = {side: read(entries, (*key, str(side))) for side, entries in opponents.items()}
    else:
        opponents = read(opponents, key)
    return {**values, "ranking": {**ranking, "opponents": opponents}}


def _with_modules(
    source: Source, values: dict[str, Any], folder: Path | None, report: Report
) -> dict[str, Any]:
    """Make the paths of files with behaviours and conditions absolute."""
    controller = values.get("controller")
    if not isinstance(controller, Mapping) or controller.get("kind") != "modules":
        return values
    controller = dict(controller)
    for key in ("behaviours", "conditions"):
        names = controller.get(key)
        if isinstance(names, list | tuple):
            base = folder or source.folder(("controller", key))
            controller[key] = [
                _resolve_name(name, base, partial(report, ("controller", key))) for name in names
            ]
    return {**values, "controller": controller}


def _with_parameter_file(
    source: Source, values: dict[str, Any], report: Report
) -> tuple[dict[str, Any], Report]:
    """Replace a parameter file of irace by its parameters; return the report for the values."""
    controller = values.get("controller")
    name = controller.get("file") if isinstance(controller, Mapping) else None
    if not isinstance(controller, Mapping) or controller.get("kind") != "parameter_set":
        return values, report
    if not isinstance(name, str) or not name:
        return values, report
    key: Path_ = ("controller", "file")

    def report_others(path: Path_, message: str) -> None:
        if path[:1] != ("controller",):  # the file's problems are the cause
            report(path, message)

    beside = [other for other in ("parameters", "forbidden") if other in controller]
    if beside:
        report(key, f"cannot be combined with {' and '.join(beside)}; write them into the file")
        return values, report_others
    file = source.folder(key) / name
    try:
        content = irace.read(file)
    except InputError as error:
        for line in str(error).splitlines():
            report(key, line)
        return values, report_others
    parameters = values.get("parameters", {})
    if isinstance(parameters, Mapping):
        values = {**values, "parameters": {**content.constants, **parameters}}
    rest = {other: value for other, value in controller.items() if other != "file"}
    read = {"parameters": content.parameters, "forbidden": content.forbidden}

    def report_line(path: Path_, message: str) -> None:
        sections = {"controller": path[1:3], "parameters": ("constants", *path[1:2])}
        line = content.lines.get(sections.get(str(path[0]) if path else "", ()))
        report(path, message if line is None else f"{file}:{line}: {message}")

    return {**values, "controller": {**rest, **read}}, report_line


def _with_classes(
    source: Source, values: dict[str, Any], folder: Path | None, report: Report, *, ask: bool
) -> dict[str, Any]:
    """Make the paths of files with methods and rankings absolute.

    `method: file.py:Class` is short for `method: {kind: file.py:Class}`.
    """
    result = dict(values)
    for name in ("method", "ranking"):
        section = values.get(name)
        kind = section.get("kind") if isinstance(section, Mapping) else section
        if not isinstance(kind, str) or not REGISTRIES[name].is_in_file(kind):
            continue
        key: Path_ = (name, "kind") if isinstance(section, Mapping) else (name,)
        base = folder or source.folder(key)
        # If a run is only read, a class without a copy is checked when it is imported.
        report_class = partial(report, key) if ask else _ignore
        options = section if isinstance(section, Mapping) else {}
        result[name] = {**options, "kind": _resolve_name(kind, base, report_class)}
    return result


def _ignore(message: str) -> None:
    """Ignore a message that is reported elsewhere."""


def _with_launchers(
    source: Source, values: dict[str, Any], folder: Path | None, report: Report
) -> dict[str, Any]:
    """Replace the launchers under `servers` by their checked options."""
    if not names_launchers(values.get("servers")):
        return values
    base = folder or source.folder(("servers",))
    launchers = entries_of(values["servers"], base, lambda path, message: report(("servers", *path), message))
    return {**values, "servers": "auto" if launchers is None else launchers}


def _resolve_name(name: Any, folder: Path, report: Callable[[str], None]) -> Any:  # noqa: ANN401 - any value of a file
    if not isinstance(name, str) or not is_in_file(name):
        return name
    if not (folder / STORE).exists():
        return make_absolute(name, folder)
    absolute_name = resolve_run_name(name, folder)
    try:
        permission.require_file(absolute_name)
    except InputError as error:
        report(str(error))
    return absolute_name
