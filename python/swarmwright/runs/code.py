"""The source of a run's simulation and plug-ins: which one is used, and how changes are handled.

A run is computed with the source that it began with, of which it keeps a copy. What the copy was taken from
is used as long as it is the same; where it is gone, as in a run folder that was moved, the copy is used.
Where it was edited, `resume` refuses unless the change is accepted, and what repeats or shows evaluations
uses the copy and says so.
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
    read_current,
    shorten_path,
    summarize_changes,
)
from swarmwright.simulations.user_code.copying import FOLDER, CopiedPart, Copy, compute_digest, with_files
from swarmwright.simulations.user_code.in_process import is_other
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
from swarmwright.simulations.user_code.permission import remember, require_copy, require_named
from swarmwright.simulations.user_code.trust import trusting

if TYPE_CHECKING:
    from swarmwright.runs.run import Run


_OF_THE_TOOL = ("method", "ranking")
"""Sections whose classes, where they are in files, are imported only if they are trusted."""
_OTHER_SIMULATION_HINT = "; --simulation FILE:Class takes another one"


def parts_of(experiment: Experiment, patterns: Sequence[str] | None = None) -> list[Part]:
    """Return the source that an experiment is run with, as far as a run keeps a copy of it.

    patterns: of files that the simulation reads; default: those that the experiment names, which must be
    there.

    Raises InputError when a file cannot be read.
    """
    simulation = experiment.simulation
    parts = [_original(part) for part in read_plug_ins(experiment)]
    if not is_python(simulation):
        return parts
    held = find_environment_copy(simulation) or Copy.find_containing(
        Path(SimulationName.parse(simulation).place).absolute()
    )
    part = choose(*held).part if held is not None else read_simulation(simulation)
    if part is None:
        return parts
    if patterns is None:
        patterns = _patterns(experiment)
        find_named_files(get_home(part), patterns)
    return [with_data(part, patterns), *parts]


def _patterns(experiment: Experiment) -> list[str]:
    """Return the patterns of files that are copied with a simulation's code."""
    entries = experiment.servers if isinstance(experiment.servers, tuple) else ()
    return files_of(entries)


def _original(part: Part) -> Part:
    """Return what the copy of another run means in the place of that copy."""
    held = Copy.find_containing(part.origin) if part.in_file else None
    return part if held is None else choose(*held).part


def of_generation(run: "Run", generation: int) -> Experiment:
    """Return a run's experiment with the plug-ins in files with which a generation was evaluated."""
    copy = copy_of(run, generation)
    return run.experiment if copy is None else _with_files(run.experiment, copy)


def _with_files(experiment: Experiment, copy: Copy, instead: Mapping[str, Part] | None = None) -> Experiment:
    """Return the experiment with the files of plug-ins that a copy has.

    instead: those that are where they were; by the names of parts.
    """

    def place(part: str, _: str) -> str | None:
        if instead is not None:
            return str(instead[part].origin) if part in instead else None
        kept = copy.parts.get(part)
        return None if kept is None else str(copy.main_path(kept).absolute())

    sections: dict[str, Any] = {name: getattr(experiment, name) for name in SECTIONS}
    given = {name: options.model_dump() for name, options in sections.items()}
    found = with_files(given, place)
    changed = {
        name: options.model_copy(
            update={key: value for key, value in found[name].items() if value != given[name].get(key)}
        )
        for name, options in sections.items()
        if found[name] != given[name]
    }
    return dataclasses.replace(experiment, **changed) if changed else experiment


def copy_of(run: "Run", generation: int | None = None) -> Copy | None:
    """Return the copy of the source with which a generation was evaluated, by default the last one.

    None where there is none, or it was deleted. Raises InputError when it was changed.
    """
    if not run.code:
        return None
    version = _version(run, generation)
    copy = Copy.find(run.path, version)
    if copy is not None and copy.digest != run.code.get(version):
        raise InputError(
            f"{copy.folder}: was changed, but copies of a run's code are kept as they were; restore it, or "
            "name the code to use: --simulation FILE:Class"
        )
    return copy


def _version(run: "Run", generation: int | None = None) -> int:
    """Return the version of the source with which a generation was evaluated, by default the last one."""
    versions = {session.session: session.code for session in run.sessions}
    used = [version for version in versions.values() if version is not None] or [max(run.code)]
    if generation is None:
        return used[-1]
    # Generations from before there were copies are attributed to the first one.
    return versions.get(run._store.session_of(generation)) or used[0]


def _is_version(run: "Run", version: int, parts: list[Part]) -> bool:
    """Whether source is a version of which the run has the SHA-256, with or without its copy."""
    return compute_digest({part.name: part.digests for part in parts}) == run.code.get(version)


def _has_copy(run: "Run", generation: int) -> bool:
    session = run._store.session_of(generation)
    return any(entry.session == session and entry.code is not None for entry in run.sessions)


def used_for(run: "Run", generation: int | None = None, simulation: str | type | None = None) -> Experiment:
    """Return the experiment with which evaluations of a run are repeated or shown.

    Its simulation is the one that the run was computed with, or another one that is named. What has changed
    since is reported as a warning.

    Args:
        run: that was computed.
        generation: whose evaluations; by default the last one's.
        simulation: a class, or `FILE:Class`, to be used instead of the run's.

    Raises InputError when there is no source, or the other class does not fit.
    """
    edited = edits.in_words(run)
    if edited is not None:
        warn_once(f"{edited}; what the run recorded is used")
    experiment = run.experiment
    if simulation is not None:
        return _with_simulation(experiment, simulation)
    redefined = _redefined(run, experiment.simulation)
    if redefined is not None:
        warn_once(f"{run.path}: {redefined}; it is used as it is now")
    copy = copy_of(run, generation)
    _check_trusted(run, experiment, copy)
    if copy is not None:
        if generation is not None and not _has_copy(run, generation):
            warn_once(
                f"{run.path}: generation {generation} was evaluated before the run had a copy of its code; "
                "its first copy is used"
            )
        for kept in copy.parts.values():
            _warn_if_changed(copy, kept)
        experiment = _with_environment(_with_files(experiment, copy), copy)
    if copy is not None and "simulation" in copy.parts and _is_copied(experiment.simulation):
        kept = copy.parts["simulation"]
        name = SimulationName.parse(experiment.simulation).in_file(copy.main_path(kept).absolute())
        return dataclasses.replace(experiment, simulation=name)
    if copy is None:
        _check_there(run, experiment.simulation)
        if _has_own_source(experiment.simulation):
            known = ""
            if run.code:
                parts = parts_of(experiment, _patterns(experiment))
                same = _is_version(run, _version(run, generation), parts)
                known = " any more, which has not changed" if same else " any more, which HAS changed"
            warn_once(
                f"{run.path}: holds no copy of its simulation's code{known}; "
                f"{shorten_path(Path(experiment.simulation))} is used as it is now"
            )
    return experiment


def _with_environment(experiment: Experiment, copy: Copy) -> Experiment:
    """Return the experiment with the copy of its environment, where the original has changed or is gone."""
    kept = copy.parts.get("simulation")
    if kept is None or not _is_environment_copied(kept) or not choose(copy, kept).copied:
        return experiment
    return dataclasses.replace(experiment, simulation=format_environment_copy(copy, kept))


def _redefined(run: "Run", simulation: str) -> str | None:
    """Return in words that a class of this notebook has other code than in the run; None where it has not."""
    versions: dict[str, str] = {}
    for session in run.sessions:
        versions |= session.versions
    if not is_other(simulation, versions):
        return None
    return f"the class {simulation.rpartition(':')[2]} was redefined after the run was computed with it"


def _notebook_notes(run: "Run", simulation: str, *, accept_changed_code: bool) -> list[str]:
    """Return what is noted of a class of this notebook. Raises InputError where a change was not accepted."""
    redefined = _redefined(run, simulation)
    if redefined is None:
        return []
    if not accept_changed_code:
        raise InputError(
            f"{run.path}: {redefined}. Generations that different code evaluated cannot be compared. Define "
            "the class as it was, or start a new run, or go on nevertheless with accept_changed_code=True, "
            "which is noted in the run."
        )
    return [f"changed code accepted from generation {run.generations} on: {redefined}"]


def remarks(run: "Run") -> list[str]:
    """Return in words what was edited since the run: its experiment.yaml, its simulation, plug-ins."""
    found = []
    edited = edits.in_words(run)
    if edited is not None:
        found.append(edited)
    try:
        copy = copy_of(run)
        if copy is not None:
            differing = ((kept, _differing(copy, kept)) for kept in copy.parts.values())
            found += [
                f"{_component_label(kept)}: {summarize_changes(kept, now)}"
                for kept, now in differing
                if now is not None
            ]
    except InputError as error:
        found.append(str(error))
    return found


@dataclass(frozen=True)
class Continuation:
    """The source with which a run continues."""

    experiment: Experiment
    used: list[Part]
    """The source that is used."""
    copy: Copy | None
    """Its copy, None where the run has none yet, or there is nothing to copy."""
    version: int
    """Of that copy, also when it has yet to be made."""
    notes: list[str]
    """What was changed deliberately, for the record."""
    edited: tuple[str, ...] = ()
    """In words, what of it was edited in the code of plug-ins, which make the candidates."""


def continuation(
    run: "Run",
    experiment: Experiment,
    *,
    accept_changed_code: bool = False,
    simulation: str | type | None = None,
) -> Continuation:
    """Decide with which source a run goes on.

    Args:
        run: to go on with.
        experiment: as it is to go on.
        accept_changed_code: go on although simulation or plug-ins have changed.
        simulation: a class, or `FILE:Class`, instead of the run's.

    Raises InputError when something has changed that was not accepted, or there is no source.
    """
    named = None if simulation is None else _with_simulation(experiment, simulation)
    notes = _notebook_notes(run, (named or experiment).simulation, accept_changed_code=accept_changed_code)
    copy = copy_of(run)
    if copy is None:
        if named is None:
            _check_trusted(run, experiment, copy)
        experiment = named or experiment
        _check_there(run, experiment.simulation)
        parts = parts_of(experiment, _patterns(run.experiment) if run.code else None)
        if run.code:
            return _without_copy(run, experiment, parts, accept_changed_code=accept_changed_code)
        if parts:
            first = run.generations
            warn_once(
                f"{run.path}: holds no copy of its code, so it is not known whether that has changed since "
                f"the run was begun; from generation {first} on there is one"
            )
            notes.append(f"code is kept from generation {first} on")
        return Continuation(experiment, parts, None, 1, notes)
    now = {
        name: _with_data_of(read_simulation(named.simulation), kept)
        if named is not None and name == "simulation"
        else read_current(copy, kept)
        for name, kept in copy.parts.items()
    }
    compared = {name: _as_kept(copy.parts[name], part) for name, part in now.items() if part is not None}
    changed = {name: part for name, part in compared.items() if not _is_same(copy.parts[name], part)}
    if not changed:
        if named is None:
            _check_trusted(run, experiment, copy)
        used = [part for part in now.values() if part is not None]
        return Continuation(named or _with_environment(experiment, copy), used, copy, copy.version, notes)
    if not accept_changed_code:
        raise InputError(
            f"{_changes_in_words(run, copy, changed)}\n"
            "Generations that different code evaluated cannot be compared. "
            f"Restore what was edited (the run's copy is in {shorten_path(copy.folder)}), or start a new "
            "run, or go on nevertheless with --accept-changed-code, which is noted in the run (in Python, "
            "accept_changed_code=True)."
        )
    if named is None:
        # The accepted difference of the code is known.
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
    """Trust methods and rankings in files as they were changed to, if the run's copy is trusted."""
    for name in _OF_THE_TOOL:
        part = changed.get(name)
        if part is not None and part.in_file:
            require_copy(copy, copy.parts[name], choose(copy, copy.parts[name]))
            remember([part])


def _with_data_of(part: Part | None, kept: CopiedPart) -> Part | None:
    return None if part is None else with_data(part, kept.patterns)


def _without_copy(
    run: "Run", experiment: Experiment, parts: list[Part], *, accept_changed_code: bool
) -> Continuation:
    """Go on where the copy was deleted: of what it was, the SHA-256 is known."""
    version = _version(run)
    if _is_version(run, version, parts):
        return Continuation(experiment, parts, None, version, [])
    if not accept_changed_code:
        raise InputError(
            f"{run.path}: the code of this run has changed since it was begun. How cannot be shown, as the "
            f"copy, {FOLDER}/{version}, was deleted. Restore one of the two, or start a new run, or go on "
            "nevertheless with --accept-changed-code, which is noted in the run (in Python, "
            "accept_changed_code=True)."
        )
    note = f"changed code accepted from generation {run.generations} on: the copy of what it was is deleted"
    return Continuation(experiment, parts, None, max(run.code) + 1, [note])


def changed_code(run: "Run", experiment: Experiment) -> str | None:
    """Return how an experiment's source differs from that of a run of it, None where it does not.

    None, too, where the run has no copy. Raises InputError when a file cannot be read or the copy was edited.
    """
    copy = copy_of(run)
    if copy is None:
        return _redefined(run, experiment.simulation)
    kept = copy.parts.get("simulation")
    now = {
        part.name: _as_kept(copy.parts[part.name], part)
        for part in parts_of(experiment, kept.patterns if kept is not None else ())
        if part.name in copy.parts
    }
    changed = {name: part for name, part in now.items() if not _is_same(copy.parts[name], part)}
    return _changes_in_words(run, copy, changed) if changed else None


def _check_trusted(run: "Run", experiment: Experiment, copy: Copy | None, *, accepted: bool = False) -> None:
    """Raise InputError unless the code of a run may be executed.

    accepted: whether what has changed since its copy was made may.
    """
    if not is_python(experiment.simulation):
        return
    if copy is not None and "simulation" in copy.parts:
        kept = copy.parts["simulation"]
        require_copy(copy, kept, choose(copy, kept))
        if accepted or _is_copied(experiment.simulation) or _is_environment_copied(kept):
            return
    _check_there(run, experiment.simulation)
    require_named(experiment.simulation)


def check_trusted(run: "Run") -> None:
    """Raise InputError unless the code of a run may be executed: see `simulations.user_code.trust`."""
    _check_trusted(run, run.experiment, copy_of(run))


def trust_code(run: "Run") -> None:
    """Trust the code of a run, every copy of it. Raises InputError when it is gone or was changed."""
    with trusting():
        for version in run.code:
            copy = Copy.find(run.path, version)
            if copy is None:
                continue
            for kept in copy.parts.values():
                if kept.name == "simulation" or kept.in_file:
                    require_copy(copy, kept, choose(copy, kept))
        check_trusted(run)


def _changes_in_words(run: "Run", copy: Copy, changed: dict[str, Part]) -> str:
    """Return what has changed in words, with the differences below."""
    lines = []
    for name, part in changed.items():
        kept = copy.parts[name]
        lines.append(
            f"{run.path}: {_component_label(kept)} has changed since the run was begun: "
            f"{summarize_changes(kept, part)}"
        )
        lines.append(format_difference(copy, kept, part))
    return "\n".join(line for line in lines if line)


def _warn_if_changed(copy: Copy, kept: CopiedPart) -> None:
    """Say that a component has changed since the run."""
    now = _differing(copy, kept)
    if now is None:
        return
    if kept.in_file and is_plug_in(kept.name):
        changes.warn_of_copy(copy, kept, now)
    elif _is_environment_copied(kept):
        changes.warn_of_copy(copy, kept, now, f"; --simulation {kept.component} takes it as it is now")
    elif is_plug_in(kept.name) or is_environment(kept.component):
        warn_once(
            f"{shorten_path(copy.run)}: {_component_label(kept)}: {summarize_changes(kept, now)} since; the "
            "current version is used"
        )
    else:
        changes.warn_of_copy(copy, kept, now, _OTHER_SIMULATION_HINT)


def _differing(copy: Copy, kept: CopiedPart) -> Part | None:
    """Return the current source in the place of what was copied, None where it is the same or missing."""
    now = read_current(copy, kept)
    return None if now is None or now.digests == dict(kept.digests) else now


def _component_label(kept: CopiedPart) -> str:
    parsed = SimulationName.parse(kept.component)
    return f"{kept.name} {parsed.label if parsed.is_command else kept.component}"


def _is_copied(simulation: str) -> bool:
    """Whether an experiment's simulation is a class or a command in a run's copy."""
    parsed = SimulationName.parse(simulation)
    return not parsed.is_environment and Copy.find_containing(Path(parsed.place)) is not None


def _is_environment_copied(kept: CopiedPart) -> bool:
    """Whether a component is an environment that can be made from its copy."""
    return SimulationName.parse(kept.component).library in {"gymnasium", "pettingzoo"}


def _has_own_source(simulation: str) -> bool:
    """Whether runs of a simulation keep a copy of its source."""
    parsed = SimulationName.parse(simulation)
    package = parsed.place.partition(".")[0]
    return parsed.is_python and not parsed.is_environment and package not in {"__main__", "swarmwright"}


def _check_there(run: "Run", simulation: str) -> None:
    parsed = SimulationName.parse(simulation)
    if parsed.is_command:
        if not Path(parsed.place).parent.is_dir():
            raise InputError(
                f"{run.path}: the files of its simulation are gone: there is no folder "
                f"{Path(parsed.place).parent}; restore it"
            )
    elif parsed.is_python and parsed.file is not None and not parsed.file.is_file():
        raise InputError(
            f"{run.path}: the code of its simulation is gone: there is no {parsed.place}, and the run holds "
            f"no copy of it; put {parsed.file.name} beside the run folder, or name the file: "
            f"--simulation FILE:{parsed.member} (in Python, simulation=..)"
        )


def _with_simulation(experiment: Experiment, simulation: str | type) -> Experiment:
    """Return the experiment with another class. Raises InputError when that does not fit the run."""
    name = name_of(simulation) if isinstance(simulation, type) else simulation
    if not is_python(name):
        raise InputError(
            f"simulation: {name!r} names no class in Python: FILE.py:Class or package.module:Class"
        )
    name = make_absolute(name)
    announced = catalogue.description(name)
    for key in ("sensors", "actuators"):
        recorded = getattr(experiment, key)
        if recorded is not None and steers_agents(experiment) and announced[key] != recorded:
            raise InputError(
                f"simulation: {name} has {announced[key]} {key}, but the run's controllers are made for "
                f"{recorded}; start a new run with it"
            )
    mistakes = catalogue.parameter_mistakes(name, experiment.parameters)
    if mistakes:
        raise InputError(f"simulation: {name} refuses the run's parameters: {'; '.join(map(str, mistakes))}")
    return dataclasses.replace(experiment, simulation=name)


def _name_in_part(experiment: Experiment, part: Part) -> str:
    place = part.origin if part.module is None else part.module
    return SimulationName.parse(experiment.simulation).in_file(place)


def _as_kept(kept: CopiedPart, part: Part) -> Part:
    """Return a part whose main file is called as in the copy, so that the two can be compared."""
    if part.main == kept.main or part.module is not None or kept.module is not None:
        return part
    files = {kept.main if place == part.main else place: source for place, source in part.files.items()}
    return dataclasses.replace(part, main=kept.main, files=files)


def _is_same(kept: CopiedPart, part: Part) -> bool:
    classes = [SimulationName.parse(either.component).label for either in (kept, part)]
    return classes[0] == classes[1] and part.digests == dict(kept.digests)
