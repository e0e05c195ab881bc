"""The code of a run's simulation and plug-ins: which version is used, and how changes are handled.

A run keeps a copy of the code that it began with. The original is used as long as it equals the copy; if it
is missing, as in a run folder that was moved, the copy is used. If it was edited, `resume` refuses to
continue unless the change is accepted; commands that repeat or show evaluations use the copy and say so.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarmwright.common.errors import InputError
from swarmwright.common.simulation_names import SimulationName, is_environment, is_python
from swarmwright.common.warn_once import warn_once
from swarmwright.experiment.derived import steers_agents
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.launcher_entries import files_of
from swarmwright.runs import edits
from swarmwright.simulations import catalogue
from swarmwright.simulations.names import (
    find_environment_copy,
    format_environment_copy,
    make_absolute,
    name_of,
)
from swarmwright.simulations.user_code import changes
from swarmwright.simulations.user_code.changes import (
    choose,
    format_difference,
    is_other,
    read_current,
    shorten_path,
    summarize_changes,
)
from swarmwright.simulations.user_code.copying import FOLDER, CopiedPart, Copy, compute_digest, with_files
from swarmwright.simulations.user_code.parts import (
    SECTIONS,
    Part,
    find_named_files,
    get_home,
    is_plug_in,
    read_plug_ins,
    read_simulation,
    with_data,
)
from swarmwright.simulations.user_code.permission import remember, require_copy, require_named, trusts
from swarmwright.simulations.user_code.trust import trusting

if TYPE_CHECKING:
    from swarmwright.runs.run import Run


_OPTIMIZER_SECTIONS = ("method", "ranking")
"""Sections whose classes in files are imported only if they are trusted."""
_OTHER_SIMULATION_HINT = "; use --simulation FILE:Class for another version"


def collect_code(experiment: Experiment, patterns: Sequence[str] | None = None) -> list[Part]:
    """Collect the code of an experiment that a run copies.

    patterns: patterns of files that the simulation reads; by default those that the experiment names, which
    must exist.

    Raises InputError when a file cannot be read.
    """
    simulation = experiment.simulation
    parts = [_find_original(part) for part in read_plug_ins(experiment)]
    if not is_python(simulation):
        return parts
    held = find_environment_copy(simulation) or Copy.find_containing(
        Path(SimulationName.parse(simulation).location).absolute()
    )
    part = choose(*held).part if held is not None else read_simulation(simulation)
    if part is None:
        return parts
    if patterns is None:
        patterns = _patterns(experiment)
        find_named_files(get_home(part), patterns)
    return [with_data(part, patterns), *parts]


def is_code_trusted(experiment: Experiment) -> bool:
    """Return whether all code that an experiment names is trusted, without executing or asking."""
    try:
        simulation = read_simulation(experiment.simulation)
        parts = [*read_plug_ins(experiment), *([] if simulation is None else [simulation])]
    except InputError:
        return False
    return all(map(trusts, parts))


def _patterns(experiment: Experiment) -> list[str]:
    """Return the patterns of files that are copied with a simulation's code."""
    entries = experiment.servers if isinstance(experiment.servers, tuple) else ()
    return files_of(entries)


def _find_original(part: Part) -> Part:
    """Return the original of a part that is a copy in another run."""
    held = Copy.find_containing(part.origin) if part.in_file else None
    return part if held is None else choose(*held).part


def restore_experiment(run: "Run", generation: int) -> Experiment:
    """Return a run's experiment with the plug-in files that evaluated a generation."""
    copy = find_copy(run, generation)
    return run.experiment if copy is None else _with_files(run.experiment, copy)


def _with_files(experiment: Experiment, copy: Copy, instead: Mapping[str, Part] | None = None) -> Experiment:
    """Return the experiment with the plug-in files of a copy.

    instead: original parts by name, to use their files instead.
    """

    def find_file(part: str, _: str) -> str | None:
        if instead is not None:
            return str(instead[part].origin) if part in instead else None
        copied = copy.parts.get(part)
        return None if copied is None else str(copy.main_path(copied).absolute())

    sections: dict[str, Any] = {name: getattr(experiment, name) for name in SECTIONS}
    before = {name: options.model_dump() for name, options in sections.items()}
    after = with_files(before, find_file)
    changed = {
        name: options.model_copy(
            update={key: value for key, value in after[name].items() if value != before[name].get(key)}
        )
        for name, options in sections.items()
        if after[name] != before[name]
    }
    return dataclasses.replace(experiment, **changed) if changed else experiment


def find_copy(run: "Run", generation: int | None = None) -> Copy | None:
    """Return the copy of the code that evaluated a generation, by default the last.

    None if there is no copy, or it was deleted. Raises InputError when it was changed.
    """
    if not run.code:
        return None
    version = _version(run, generation)
    copy = Copy.find(run.path, version)
    if copy is not None and copy.digest != run.code.get(version):
        raise InputError(
            f"{copy.folder}: the run's copy of the code was changed; restore it, or specify the code to use: "
            "--simulation FILE:Class"
        )
    return copy


def _version(run: "Run", generation: int | None = None) -> int:
    """Return the version of the code that evaluated a generation, by default the last."""
    versions = {session.session: session.code for session in run.sessions}
    used = [version for version in versions.values() if version is not None] or [max(run.code)]
    if generation is None:
        return used[-1]
    # Generations before the first copy are attributed to it.
    return versions.get(run._store.session_of(generation)) or used[0]


def _is_version(run: "Run", version: int, parts: list[Part]) -> bool:
    """Return whether code matches the SHA-256 of a version of the run, whether or not its copy exists."""
    return compute_digest({part.name: part.digests for part in parts}) == run.code.get(version)


def _has_copy(run: "Run", generation: int) -> bool:
    session = run._store.session_of(generation)
    return any(entry.session == session and entry.code is not None for entry in run.sessions)


def resolve_experiment(
    run: "Run", generation: int | None = None, simulation: str | type | None = None
) -> Experiment:
    """Return the experiment for repeating or showing evaluations of a run.

    It has the simulation that computed the run, or `simulation`. Changes since the run are reported as
    warnings.

    Args:
        run: the run.
        generation: generation of the evaluations; by default the last.
        simulation: a class, or `FILE:Class`, in place of the run's.

    Raises InputError when the code is missing, or the other class does not fit the run.
    """
    edited = edits.describe_file_edits(run)
    if edited is not None:
        warn_once(f"{edited}; using the recorded experiment")
    experiment = run.experiment
    if simulation is not None:
        return _with_simulation(experiment, simulation)
    redefined = _describe_redefinition(run, experiment.simulation)
    if redefined is not None:
        warn_once(f"{run.path}: {redefined}; using the present class")
    copy = find_copy(run, generation)
    _check_trusted(run, experiment, copy)
    if copy is not None:
        if generation is not None and not _has_copy(run, generation):
            warn_once(
                f"{run.path}: generation {generation} was evaluated before the run had a copy of its code; "
                "using the first copy"
            )
        for copied in copy.parts.values():
            _warn_if_changed(copy, copied)
        experiment = _with_environment(_with_files(experiment, copy), copy)
    if copy is not None and "simulation" in copy.parts and _is_copied(experiment.simulation):
        copied = copy.parts["simulation"]
        name = SimulationName.parse(experiment.simulation).with_file(copy.main_path(copied).absolute())
        return dataclasses.replace(experiment, simulation=name)
    if copy is None:
        _check_simulation_exists(run, experiment.simulation)
        if _has_own_source(experiment.simulation):
            change = ""
            if run.code:
                parts = collect_code(experiment, _patterns(experiment))
                same = _is_version(run, _version(run, generation), parts)
                change = ", which has not changed" if same else ", which HAS changed"
            warn_once(
                f"{run.path}: has no copy of its simulation's code{change}; using the present "
                f"{shorten_path(Path(experiment.simulation))}"
            )
    return experiment


def _with_environment(experiment: Experiment, copy: Copy) -> Experiment:
    """Return the experiment with the copy of its environment if the original has changed or is missing."""
    copied = copy.parts.get("simulation")
    if copied is None or not _is_environment_copied(copied) or not choose(copy, copied).copied:
        return experiment
    return dataclasses.replace(experiment, simulation=format_environment_copy(copy, copied))


def _describe_redefinition(run: "Run", simulation: str) -> str | None:
    """Describe a notebook class whose code differs from the run's; None if it does not differ."""
    versions: dict[str, str] = {}
    for session in run.sessions:
        versions |= session.versions
    if not is_other(simulation, versions):
        return None
    return f"the class {simulation.rpartition(':')[2]} was redefined since the run"


def _notebook_notes(run: "Run", simulation: str, *, accept_changed_code: bool) -> list[str]:
    """Return notes on changes of a notebook class. Raises InputError for a change that was not accepted."""
    redefined = _describe_redefinition(run, simulation)
    if redefined is None:
        return []
    if not accept_changed_code:
        raise InputError(
            f"{run.path}: {redefined}, but generations evaluated by different code cannot be compared. "
            "Restore the class, start a new run, or continue anyway with accept_changed_code=True, which is "
            "noted in the run."
        )
    return [f"changed code accepted from generation {run.generations} on: {redefined}"]


def describe_edits(run: "Run") -> list[str]:
    """Describe the edits since the run: of its experiment.yaml, its simulation and plug-ins."""
    lines = []
    edited = edits.describe_file_edits(run)
    if edited is not None:
        lines.append(edited)
    try:
        copy = find_copy(run)
        if copy is not None:
            present_parts = ((copied, _find_edited_part(copy, copied)) for copied in copy.parts.values())
            lines += [
                f"{_component_label(copied)}: {summarize_changes(copied, now)}"
                for copied, now in present_parts
                if now is not None
            ]
    except InputError as error:
        lines.append(str(error))
    return lines


@dataclass(frozen=True)
class Continuation:
    """The code that a run continues with."""

    experiment: Experiment
    used: list[Part]
    """The code."""
    copy: Copy | None
    """Its copy, None if the run has none yet, or has no user code."""
    version: int
    """Version of the copy, even if it does not exist yet."""
    notes: list[str]
    """Descriptions of accepted changes, for the record."""
    edited: tuple[str, ...] = ()
    """Descriptions of edits of plug-ins, which create the candidates."""


def plan_continuation(
    run: "Run",
    experiment: Experiment,
    *,
    accept_changed_code: bool = False,
    simulation: str | type | None = None,
) -> Continuation:
    """Choose the code that a run continues with.

    Args:
        run: the run to resume.
        experiment: the experiment to continue with.
        accept_changed_code: continue even if the simulation or plug-ins have changed.
        simulation: a class, or `FILE:Class`, in place of the run's.

    Raises InputError when there are changes that were not accepted, or the code is missing.
    """
    named = None if simulation is None else _with_simulation(experiment, simulation)
    notes = _notebook_notes(run, (named or experiment).simulation, accept_changed_code=accept_changed_code)
    copy = find_copy(run)
    if copy is None:
        if named is None:
            _check_trusted(run, experiment, copy)
        experiment = named or experiment
        _check_simulation_exists(run, experiment.simulation)
        parts = collect_code(experiment, _patterns(run.experiment) if run.code else None)
        if run.code:
            return _continue_without_copy(run, experiment, parts, accept_changed_code=accept_changed_code)
        if parts:
            first = run.generations
            warn_once(
                f"{run.path}: has no copy of its code, so changes since its start cannot be detected; a copy "
                f"is kept from generation {first} on"
            )
            notes.append(f"code is kept from generation {first} on")
        return Continuation(experiment, parts, None, 1, notes)
    now = {
        name: _with_data_of(read_simulation(named.simulation), copied)
        if named is not None and name == "simulation"
        else read_current(copy, copied)
        for name, copied in copy.parts.items()
    }
    compared = {
        name: _rename_main_file(copy.parts[name], part) for name, part in now.items() if part is not None
    }
    changed = {name: part for name, part in compared.items() if not _is_same(copy.parts[name], part)}
    if not changed:
        if named is None:
            _check_trusted(run, experiment, copy)
        used = [part for part in now.values() if part is not None]
        return Continuation(named or _with_environment(experiment, copy), used, copy, copy.version, notes)
    if not accept_changed_code:
        raise InputError(
            f"{_describe_changes(run, copy, changed)}\n"
            "Generations evaluated by different code cannot be compared. "
            f"Restore the original code (the run's copy is in {shorten_path(copy.folder)}), start a new run, "
            "or continue anyway with --accept-changed-code, which is noted in the run (in Python: "
            "accept_changed_code=True)."
        )
    if named is None:
        # The user has accepted the changes.
        _check_trusted(run, experiment, copy, accepted=True)
    parts = [part or choose(copy, copy.parts[name]).part for name, part in now.items()]
    summaries = dict.fromkeys(summarize_changes(copy.parts[name], part) for name, part in changed.items())
    notes += [f"changed code accepted from generation {run.generations} on: {line}" for line in summaries]
    _trust_accepted(copy, changed)
    experiment = _with_files(experiment, copy, changed)
    if named is not None:
        named = dataclasses.replace(named, **{name: getattr(experiment, name) for name in SECTIONS})
    if named is None and "simulation" in changed and not is_environment(experiment.simulation):
        named = _with_simulation(experiment, _name_in_part(experiment, changed["simulation"]))
    version = max(run.code) + 1
    edited = (summarize_changes(copy.parts[name], part) for name, part in changed.items() if is_plug_in(name))
    return Continuation(named or experiment, parts, None, version, notes, tuple(dict.fromkeys(edited)))


def _trust_accepted(copy: Copy, changed: Mapping[str, Part]) -> None:
    """Trust changed methods and rankings in files if the run's copy is trusted."""
    for name in _OPTIMIZER_SECTIONS:
        part = changed.get(name)
        if part is not None and part.in_file:
            require_copy(copy, copy.parts[name], choose(copy, copy.parts[name]))
            remember([part])


def _with_data_of(part: Part | None, copied: CopiedPart) -> Part | None:
    return None if part is None else with_data(part, copied.patterns)


def _continue_without_copy(
    run: "Run", experiment: Experiment, parts: list[Part], *, accept_changed_code: bool
) -> Continuation:
    """Continue without the deleted copy, of which only the SHA-256 is known."""
    version = _version(run)
    if _is_version(run, version, parts):
        return Continuation(experiment, parts, None, version, [])
    if not accept_changed_code:
        raise InputError(
            f"{run.path}: the code of this run has changed since it began; the changes cannot be shown, "
            f"because the copy {FOLDER}/{version} was deleted. Restore the code or the copy, start a new "
            "run, or continue anyway with --accept-changed-code, which is noted in the run (in Python: "
            "accept_changed_code=True)."
        )
    note = f"changed code accepted from generation {run.generations} on: its original copy was deleted"
    return Continuation(experiment, parts, None, max(run.code) + 1, [note])


def describe_code_changes(run: "Run", experiment: Experiment) -> str | None:
    """Describe how an experiment's code differs from that of a run; None if it does not, or without a copy.

    Raises InputError when a file cannot be read or the copy was edited.
    """
    copy = find_copy(run)
    if copy is None:
        return _describe_redefinition(run, experiment.simulation)
    copied = copy.parts.get("simulation")
    now = {
        part.name: _rename_main_file(copy.parts[part.name], part)
        for part in collect_code(experiment, copied.patterns if copied is not None else ())
        if part.name in copy.parts
    }
    changed = {name: part for name, part in now.items() if not _is_same(copy.parts[name], part)}
    return _describe_changes(run, copy, changed) if changed else None


def _check_trusted(run: "Run", experiment: Experiment, copy: Copy | None, *, accepted: bool = False) -> None:
    """Raise InputError unless the code of a run may be executed.

    accepted: whether changes since the copy are trusted.
    """
    if not is_python(experiment.simulation):
        return
    if copy is not None and "simulation" in copy.parts:
        copied = copy.parts["simulation"]
        require_copy(copy, copied, choose(copy, copied))
        if accepted or _is_copied(experiment.simulation) or _is_environment_copied(copied):
            return
    _check_simulation_exists(run, experiment.simulation)
    require_named(experiment.simulation)


def check_trusted(run: "Run") -> None:
    """Raise InputError unless the code of a run may be executed: see `simulations.user_code.trust`."""
    _check_trusted(run, run.experiment, find_copy(run))


def trust_code(run: "Run") -> None:
    """Trust all copies of a run's code. Raises InputError when the code is missing or was changed."""
    with trusting():
        for version in run.code:
            copy = Copy.find(run.path, version)
            if copy is None:
                continue
            for copied in copy.parts.values():
                if copied.name == "simulation" or copied.in_file:
                    require_copy(copy, copied, choose(copy, copied))
        check_trusted(run)


def _describe_changes(run: "Run", copy: Copy, changed: dict[str, Part]) -> str:
    """Describe the changes, each followed by its diff."""
    lines = []
    for name, part in changed.items():
        copied = copy.parts[name]
        lines.append(
            f"{run.path}: {_component_label(copied)} has changed since the run began: "
            f"{summarize_changes(copied, part)}"
        )
        lines.append(format_difference(copy, copied, part))
    return "\n".join(line for line in lines if line)


def _warn_if_changed(copy: Copy, copied: CopiedPart) -> None:
    """Warn if a component has changed since the run."""
    now = _find_edited_part(copy, copied)
    if now is None:
        return
    if copied.in_file and is_plug_in(copied.name):
        changes.warn_of_copy(copy, copied, now)
    elif _is_environment_copied(copied):
        changes.warn_of_copy(
            copy, copied, now, f"; use --simulation {copied.component} for the present version"
        )
    elif is_plug_in(copied.name) or is_environment(copied.component):
        warn_once(
            f"{shorten_path(copy.run)}: {_component_label(copied)}: {summarize_changes(copied, now)} since; "
            "using the present version"
        )
    else:
        changes.warn_of_copy(copy, copied, now, _OTHER_SIMULATION_HINT)


def _find_edited_part(copy: Copy, copied: CopiedPart) -> Part | None:
    """Return the present code of a copied part if it differs from the copy; None otherwise or if missing."""
    now = read_current(copy, copied)
    return None if now is None or now.digests == dict(copied.digests) else now


def _component_label(copied: CopiedPart) -> str:
    parsed = SimulationName.parse(copied.component)
    return f"{copied.name} {parsed.label if parsed.is_command else copied.component}"


def _is_copied(simulation: str) -> bool:
    """Return whether an experiment's simulation is a class or a command in a run's copy."""
    parsed = SimulationName.parse(simulation)
    return not parsed.is_environment and Copy.find_containing(Path(parsed.location)) is not None


def _is_environment_copied(copied: CopiedPart) -> bool:
    """Return whether a component is an environment that can be created from its copy."""
    return SimulationName.parse(copied.component).library in {"gymnasium", "pettingzoo"}


def _has_own_source(simulation: str) -> bool:
    """Return whether runs of a simulation keep a copy of its code."""
    parsed = SimulationName.parse(simulation)
    package = parsed.location.partition(".")[0]
    return parsed.is_python and not parsed.is_environment and package not in {"__main__", "swarmwright"}


def _check_simulation_exists(run: "Run", simulation: str) -> None:
    parsed = SimulationName.parse(simulation)
    if parsed.is_command:
        if not Path(parsed.location).parent.is_dir():
            raise InputError(
                f"{run.path}: the folder of its simulation, {Path(parsed.location).parent}, is missing; "
                "restore "
                "it"
            )
    elif parsed.is_python and parsed.file is not None and not parsed.file.is_file():
        raise InputError(
            f"{run.path}: the code of its simulation, {parsed.location}, is missing, and the run has no "
            "copy of "
            f"it; put {parsed.file.name} beside the run folder, or specify it with --simulation "
            f"FILE:{parsed.member} (in Python: simulation=..)"
        )


def _with_simulation(experiment: Experiment, simulation: str | type) -> Experiment:
    """Return the experiment with another simulation. Raises InputError when that does not fit the run."""
    name = name_of(simulation) if isinstance(simulation, type) else simulation
    if not is_python(name):
        raise InputError(
            f"simulation: {name!r} is not a Python class; use FILE.py:Class or package.module:Class"
        )
    name = make_absolute(name)
    announced = catalogue.description(name)
    for key in ("sensors", "actuators"):
        recorded = getattr(experiment, key)
        if recorded is not None and steers_agents(experiment) and announced[key] != recorded:
            raise InputError(
                f"simulation: {name} has {announced[key]} {key}, but the run's controllers need {recorded}; "
                "start a new run with it"
            )
    mistakes = catalogue.parameter_mistakes(name, experiment.parameters)
    if mistakes:
        raise InputError(f"simulation: {name} rejects the run's parameters: {'; '.join(map(str, mistakes))}")
    return dataclasses.replace(experiment, simulation=name)


def _name_in_part(experiment: Experiment, part: Part) -> str:
    location = part.origin if part.module is None else part.module
    return SimulationName.parse(experiment.simulation).with_file(location)


def _rename_main_file(copied: CopiedPart, part: Part) -> Part:
    """Return a part whose main file has the name in the copy, so that the two can be compared."""
    if part.main == copied.main or part.module is not None or copied.module is not None:
        return part
    files = {copied.main if path == part.main else path: source for path, source in part.files.items()}
    return dataclasses.replace(part, main=copied.main, files=files)


def _is_same(copied: CopiedPart, part: Part) -> bool:
    old, new = (SimulationName.parse(component).label for component in (copied.component, part.component))
    return old == new and part.digests == dict(copied.digests)
