"""Checking a bundle that somebody hands over: its files, its formats, and the fitness that it states.

Checking the fitness that a bundle states: by its episodes, and by evaluating them again.

Reading the files of a bundle that somebody hands over, before anything in them is believed.
"""

import hashlib
import math
import re
import stat
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from swarmwright.common import archives
from swarmwright.common.arguments import check_arguments
from swarmwright.common.errors import InputError, RunError, SwarmwrightError
from swarmwright.common.json_text import loads
from swarmwright.common.untrusted import escape_line
from swarmwright.controllers.modules.grammar import PYTHON_KIND
from swarmwright.controllers.source.text import check_prefix
from swarmwright.experiment.experiment import recorded_experiment
from swarmwright.export import EXPORTERS
from swarmwright.export._base import Exporter, Files, NotInstalledError, file_bytes
from swarmwright.export.bundle import (
    CONTROLLER,
    EPISODES,
    EVALUATION,
    FORMAT,
    LICENSE,
    MANIFEST,
    MAPPING,
    episodes_of,
)
from swarmwright.export.sequences import Sequences, difference
from swarmwright.export.subject import Subject, fitness_words
from swarmwright.export.verification import Verification, verify


@dataclass(repr=False)
class BundleVerification:
    """What the check of a bundle found."""

    file: Path
    digest: str
    """SHA-256 of the manifest, in hexadecimal. Compare it with that of the sender."""
    facts: list[tuple[str, str]]
    """Where the controller comes from, in lines of a name and a text."""
    files: int
    """Files that are as the manifest says."""
    forms: dict[str, Verification] = field(default_factory=dict)
    """By export format, how it compares with the engine's controller."""
    unverified: dict[str, str] = field(default_factory=dict)
    """By export format, why it was not run; `fitness`: why it could not be compared with its episodes."""
    formats_not_checked: dict[str, str] = field(default_factory=dict)
    """By export format, in short, why not even its files could be checked, such as "written by Swarmwright
    9.9". Others in `unverified` have the files that this version exports."""
    episodes: int = 0
    """Episodes in which the controller was evaluated again, with the fitness that is stated."""
    not_evaluated: str = ""
    """Why it was not evaluated again, such as a simulation that is not built in; empty where it was."""
    problems: list[str] = field(default_factory=list)
    """What is not as stated."""

    def __repr__(self) -> str:
        """Say what was found."""
        return f"<BundleVerification of {self.file}: {self}>"

    def __str__(self) -> str:
        """Say in a line whether the bundle is as stated, the largest difference, and what was not checked."""
        return _in_words(self)

    @property
    def ok(self) -> bool:
        """Whether all that was checked is as stated."""
        return not self.problems

    @property
    def fitness_not_checked(self) -> str:
        """Why the stated fitness was not checked; empty where it was."""
        return self.not_evaluated or self.unverified.get("fitness", "")

    @property
    def largest_difference(self) -> float:
        """Between actuators of all formats that were run, absolute."""
        return max((form.largest_difference for form in self.forms.values()), default=0.0)

    def to_mapping(self) -> dict[str, Any]:
        """Return the report as plain values."""
        return {
            "ok": self.ok,
            "fitness_checked": not self.fitness_not_checked,
            "digest": self.digest,
            "files": self.files,
            "forms": {name: form.to_mapping() for name, form in self.forms.items()},
            "unverified": self.unverified,
            "formats_not_checked": self.formats_not_checked,
            "largest_difference": self.largest_difference,
            "episodes": self.episodes,
            "not_evaluated": self.not_evaluated,
            "problems": self.problems,
        }


def _in_words(report: BundleVerification) -> str:
    """Return one line: whether the bundle is as stated, the largest difference, and what was not checked."""
    if not report.ok:
        many = len(report.problems)
        return f"FAILED: {many} problem{'s' if many > 1 else ''}"
    unchecked = report.fitness_not_checked
    if report.formats_not_checked:
        return _in_words_in_part(report, unchecked)
    if not report.forms:
        if unchecked:
            return f"Not verified: no exported code was run, and the fitness was not checked: {unchecked}"
        return "Fitness verified; no exported code was run"
    found = f"largest difference {report.largest_difference:.3g} ({', '.join(report.forms)})"
    if unchecked:
        return f"Controller code verified: {found}; its fitness was not checked: {unchecked}"
    return f"Verified: {found}"


def _in_words_in_part(report: BundleVerification, fitness: str) -> str:
    """Return the line where files of formats were not checked; fitness: why that was not, or empty."""
    by_reason: dict[str, list[str]] = {}
    for form, reason in report.formats_not_checked.items():
        by_reason.setdefault(reason, []).append(form)
    if fitness:
        by_reason.setdefault(fitness, []).append("the fitness")
    rest = "not checked: " + ", ".join(f"{', '.join(what)} ({why})" for why, what in by_reason.items())
    if report.forms:
        return f"Controller code verified in part: {', '.join(report.forms)}; {rest}"
    begin = "Not verified" if fitness else "Fitness verified"
    return f"{begin}; no exported code was run; {rest}"


_LARGEST_BUNDLE_BYTES = 1 << 28
"""Bytes of all files of a bundle."""


def read_files(path: Path) -> dict[str, bytes]:
    """Return the files of a bundle by name, of the archive or of the folder that it was unpacked to.

    Raises InputError when it cannot be read, has no manifest, or has files that no bundle has: a name outside
    its folder, a link or a device, one name twice, or too many bytes.
    """
    if path.is_dir():
        return _read_folder(path)
    with archives.open_archive(path, "a bundle") as archive:
        for info in archive.infolist():
            if stat.S_IFMT(info.external_attr >> 16) not in (0, stat.S_IFREG, stat.S_IFDIR):
                raise InputError(_not_plain(path, info.filename))
        infos = [info for info in archive.infolist() if not info.is_dir()]  # other programs add folders
        _check_size(path, sum(info.file_size for info in infos))
        names = [info.filename for info in infos]
        if len(set(names)) < len(names):
            raise InputError(f"{path}: has a file twice: {escape_line(_twice(names))}")
        _check_manifest(path, names)
        return {name: archives.read_entry(archive, path, name, _LARGEST_BUNDLE_BYTES) for name in names}


def _read_folder(folder: Path) -> dict[str, bytes]:
    """Return the files of an unpacked bundle by name; links are not followed."""
    try:
        files = {
            file.relative_to(folder).as_posix(): file
            for file in sorted(folder.rglob("*"))
            if file.is_symlink() or not file.is_dir()
        }
        _check_manifest(folder, files)
        for name, file in files.items():
            _check_name(folder, name)
            if file.is_symlink() or not file.is_file():
                raise InputError(_not_plain(folder, name))
        _check_size(folder, sum(file.stat().st_size for file in files.values()))
        return {name: file.read_bytes() for name, file in files.items()}
    except OSError as error:
        raise InputError(f"{folder}: cannot be read: {error.strerror or error}") from error


def _not_plain(path: Path, name: str) -> str:
    return f"{path}: {escape_line(name)}: is not a plain file; no bundle has others"


def _check_name(path: Path, name: str) -> None:
    """Raise InputError for a name that some programs unpack to a place outside the bundle's folder."""
    if archives.is_outside(name):
        raise InputError(
            f"{path}: {escape_line(name)}: is not a name inside a folder (absolute, with .., a backslash or "
            "a "
            "drive letter); no bundle has such names"
        )


def _check_size(path: Path, size: int) -> None:
    if size > _LARGEST_BUNDLE_BYTES:
        raise InputError(
            f"{path}: has more than {_LARGEST_BUNDLE_BYTES >> 20} MiB of files; no bundle is so large"
        )


def _check_manifest(path: Path, names: Collection[str]) -> None:
    if MANIFEST not in names:
        raise InputError(
            f"{path}: is not a bundle: it has no {MANIFEST}; "
            "`swarmwright export RUN --bundle FILE.zip` makes one"
        )


def _twice(names: list[str]) -> str:
    return next(name for name in names if names.count(name) > 1)


def check_fitness(
    evaluation: Mapping[str, Any], facts: Mapping[str, str], report: BundleVerification
) -> None:
    """Compare the stated fitness with what the stated results make, and with what the formats say."""
    from swarmwright.runs.instances import fitness_of, meaning  # noqa: PLC0415 - loads the engine

    stated = float(evaluation["fitness"])
    parts = [earlier["episodes"] for earlier in [*evaluation.get("earlier", []), evaluation]]
    try:
        experiment = recorded_experiment(evaluation["experiment"])
    except SwarmwrightError as error:  # a plug-in is not here
        report.unverified["fitness"] = str(error)
        return
    made = None
    if all(result is not None for part in parts for result in part):
        made = fitness_of(experiment, parts)
    if made is None:
        report.unverified["fitness"] = "its ranking makes it of more than these episodes"
    elif not math.isclose(made, stated, rel_tol=1e-12, abs_tol=0.0):
        report.problems.append(f"{EVALUATION}: the fitness is {stated!r}, but its episodes make {made!r}")
    said = fitness_words(stated, meaning(experiment, len(parts)))
    if "Fitness" in facts and facts["Fitness"] not in (said, repr(stated + 0.0)):
        report.problems.append(
            f"{MANIFEST}: says of the fitness {escape_line(facts['Fitness'])!r}, but {EVALUATION} {said!r}"
        )


def check_episodes(evaluation: Mapping[str, Any], subject: Subject, report: BundleVerification) -> None:
    """Evaluate the controller in the episodes of the run and those with held-out seeds."""
    from swarmwright.simulations import catalogue  # noqa: PLC0415 - loads the engine

    simulation = evaluation["experiment"].get("simulation")
    if simulation not in catalogue.titles():
        report.not_evaluated = f"the simulation {escape_line(str(simulation))} is not a built-in one"
        return
    earlier = [(part["seeds"], part["episodes"]) for part in evaluation.get("earlier", [])]
    stated = [*earlier, (evaluation["seeds"], evaluation["episodes"])]
    if evaluation["held_out"] is not None:
        stated.append((evaluation["held_out"]["seeds"], evaluation["held_out"]["episodes"]))
    for seeds, episodes in stated:
        try:
            found = _episode_fitness(evaluation["experiment"], subject, [int(seed) for seed in seeds])
        except SwarmwrightError as error:
            report.not_evaluated = str(error)
            return
        report.episodes += len(seeds)
        for seed, value, is_now in zip(seeds, episodes, found, strict=True):
            if not _same(value, is_now):
                report.problems.append(
                    f"{EVALUATION}: the fitness in the episode with seed {seed} is {is_now!r}, not {value}"
                )


def _same(stated: float | None, found: float) -> bool:
    return math.isnan(found) if stated is None else stated == found


def _episode_fitness(values: Mapping[str, Any], subject: Subject, seeds: list[int]) -> list[float]:
    from swarmwright.experiment.experiment import Experiment  # noqa: PLC0415 - loads the engine
    from swarmwright.servers.evaluation.base import Controllers  # noqa: PLC0415 - loads the engine
    from swarmwright.servers.evaluation.opening import open_backend  # noqa: PLC0415 - loads the engine

    experiment = Experiment.from_mapping(dict(values))
    architecture = {**subject.specification, "weights": []}
    weights = np.array(subject.specification["weights"], dtype=np.float32)[np.newaxis]
    with open_backend(experiment, servers="in-process") as backend:
        results = backend.evaluate(Controllers(architecture, weights), seeds, lambda *_: None)
    found: list[float] = results.fitness[0].tolist()
    return found


_KNOWN = frozenset({MANIFEST, CONTROLLER, EVALUATION, EPISODES, LICENSE, MAPPING})
"""Files beside those in the folders of formats."""
_FORMAT_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")
"""What a format of a package that is not installed here may be called: it is a folder, also on Windows."""


@check_arguments
def verify_bundle(file: str | PathLike[str]) -> BundleVerification:
    """Check a bundle, wherever it comes from; nothing that it contains is executed unless it is known.

    Every file must be as its manifest says, and one that bundles have. In the recorded episodes the engine's
    controller must do what they state, and where the simulation is a built-in one, it must get the fitness
    that is stated; where it is not, `fitness_not_checked` says so. Each export format is written again from
    the specification. Where that gives the same files, they are compiled and run as by `export --verify`.
    Where it does not, they are not run: they were changed, or another version of Swarmwright wrote them;
    `formats_not_checked` has the latter, and formats of packages that are not installed here. A file with a
    name that this version does not export is a problem, whichever version wrote the bundle.

    Args:
        file: the archive, or the folder that it was unpacked to.

    Raises InputError when it is not a bundle, or one of a later version, or has files that unpacking may
    write outside its folder: absolute names, names with `..`, backslashes or drive letters, links.

    Examples:
        >>> bundle = swarmwright.export_bundle("result", "gather.zip")
        >>> swarmwright.verify_bundle(bundle.file).problems
        []

    See also: `export_bundle`, which writes the archive.
    """
    path = Path(file)
    files = read_files(path)
    try:
        return _checked(path, files)
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        raise InputError(
            f"{path}: {MANIFEST}, or what it names, is not as a bundle has it: {error}"
        ) from None


def _checked(path: Path, files: dict[str, bytes]) -> BundleVerification:
    manifest = loads(files[MANIFEST])
    if not isinstance(manifest, Mapping) or not isinstance(manifest.get("format"), int):
        raise InputError(f"{path}: {MANIFEST}: has no format; it is not a bundle of Swarmwright")
    if manifest["format"] != FORMAT:
        raise InputError(
            f"{path}: has the format {manifest['format']}, of Swarmwright {manifest.get('swarmwright')}; "
            f"this version reads {FORMAT}"
        )
    digest = hashlib.sha256(files[MANIFEST]).hexdigest()
    facts = [(str(name), str(text)) for name, text in manifest["facts"]]
    report = BundleVerification(path, digest, facts, 0)
    _compare_files(manifest, files, report)
    if not report.ok:  # what was changed is not computed with
        return report
    subject = _subject(manifest, files, facts, report)
    prefix = str(manifest["prefix"])
    check_prefix(prefix)
    for form in manifest["forms"]:
        _check_form(str(form), prefix, subject, files, report, by=escape_line(str(manifest["swarmwright"])))
    evaluation = loads(files[EVALUATION])
    check_fitness(evaluation, dict(facts), report)
    check_episodes(evaluation, subject, report)
    return report


def _compare_files(manifest: Mapping[str, Any], files: dict[str, bytes], report: BundleVerification) -> None:
    """Report files that are not as the manifest says, and those that no bundle has, each once."""
    listed = manifest["files"]
    if not isinstance(listed, Mapping):
        raise TypeError("files is not a mapping")
    folders = {str(form) for form in manifest["forms"] if _may_be_format(str(form))}
    for name in sorted({*files, *listed} - {MANIFEST}):
        if name not in files:
            report.problems.append(f"{name}: is missing")
        elif name not in listed:
            report.problems.append(f"{name}: is not in the manifest")
        elif hashlib.sha256(files[name]).hexdigest() != listed[name]["sha256"]:
            report.problems.append(
                f"{name}: is not what was written: its SHA-256 differs from the manifest's"
            )
        elif name not in _KNOWN and ("/" not in name or name.partition("/")[0] not in folders):
            report.problems.append(f"{name}: is not a file that a bundle of this version has")
        else:
            report.files += 1


def _may_be_format(form: str) -> bool:
    """Whether a format is known here, or may be that of a package that is not installed."""
    known = EXPORTERS.names()
    # A folder C would be the folder c on some systems.
    return form in known or bool(_FORMAT_NAME.fullmatch(form) and form.lower() not in known)


def _subject(
    manifest: Mapping[str, Any],
    files: dict[str, bytes],
    facts: list[tuple[str, str]],
    report: BundleVerification,
) -> Subject:
    """Return the controller, with episodes that have been compared with what the engine's controller does."""
    from swarmwright.controllers.controller import Controller  # noqa: PLC0415 - loads the engine

    specification = loads(files[CONTROLLER])
    if specification.get("kind") == PYTHON_KIND:
        raise InputError(
            f"{CONTROLLER}: the controller has behaviours or conditions in Python, and verify executes no "
            "code of an archive; who trusts its sender can run the self-test in the folder python"
        )
    controller = Controller(specification)
    description, recorded = dict(manifest["description"]), manifest["episodes"]
    if "sensors" not in specification:
        return Subject(
            specification, tuple(facts), values=controller.parameters, ranges=dict(manifest["ranges"])
        )
    episodes = None
    if EPISODES in files:
        episodes = episodes_of(
            files[EPISODES].decode(), int(specification["sensors"]), int(specification["actuators"])
        )
        if len(episodes):
            does = Sequences.computed(specification, episodes.first, episodes.sensors, episodes.accepted)
            episodes = replace(episodes, may_overflow=does.may_overflow)
            largest, differing = difference(does, episodes.actuators)
            if differing:
                report.problems.append(
                    f"{EPISODES}: the controller does something else in these episodes: {differing:,} "
                    f"actuators differ, by up to {largest:.3g}"
                )
    return Subject(
        specification,
        tuple(facts),
        description,
        episodes,
        int(recorded["count"]),
        str(recorded["reason"]),
        topics=dict(manifest.get("topics", {})),
        step_size=_seconds("step_size", manifest),
        shown_seconds=_seconds("shown_seconds", manifest),
        wheels=_wheels(manifest.get("wheels", (0.0, 0.0))),
    )


def _wheels(value: Any) -> tuple[float, float]:  # noqa: ANN401 - whatever the manifest says
    """Return speed and distance of wheels, 0 where not known. Raises ValueError for what are none."""
    speed, base = (float(number) for number in value)
    if not (math.isfinite(speed) and math.isfinite(base) and speed >= 0 and base >= 0):
        raise ValueError(f"wheels: must be two finite numbers from 0 on, not {value}")
    return speed, base


_LONGEST_STEP_S = 1e38
"""A number of 32 bits, as headers have it."""


def _seconds(key: str, manifest: Mapping[str, Any]) -> float:
    """Return the duration of a step, 0 where it is not known. Raises ValueError for what is none."""
    step = float(manifest.get(key, 0.0))
    if not 0 <= step <= _LONGEST_STEP_S:
        raise ValueError(f"{key}: must be a number from 0 to {_LONGEST_STEP_S:g}, not {step}")
    return step


def _check_form(
    form: str, prefix: str, subject: Subject, files: dict[str, bytes], report: BundleVerification, *, by: str
) -> None:
    """Compare a format's files with what the controller is exported as, run them; by: who wrote them."""
    from swarmwright import __version__  # noqa: PLC0415 - asks the engine

    exporter = _exporter(form, report)
    if exporter is None:
        return
    elsewhere = "" if by == __version__ else f"; Swarmwright {by} wrote it, so verify with that version"
    try:
        exporter = exporter.portable()
        again: Files = exporter.files(subject, prefix)
    except NotInstalledError as error:
        _leave_out(form, "a package is not installed", str(error), report)
        return
    except SwarmwrightError as error:
        report.problems.append(f"{form}: no bundle of this controller has this format: {error}{elsewhere}")
        return
    there = {
        name.removeprefix(f"{form}/"): data for name, data in files.items() if name.startswith(f"{form}/")
    }
    foreign = sorted(there.keys() - again.keys())
    if foreign:
        report.problems += [
            f"{form}/{name}: is not a file that this version exports{elsewhere}" for name in foreign
        ]
        return
    if there != {name: file_bytes(content) for name, content in again.items()}:
        if by == __version__:
            report.problems.append(f"{form}: its files are not those that the controller is exported as")
        else:
            reason = f"Swarmwright {by} wrote it; this version, {__version__}, exports it differently"
            _leave_out(form, f"written by Swarmwright {by}", reason, report)
        return
    _run_form(form, exporter, subject, prefix, again, report)


def _exporter(form: str, report: BundleVerification) -> Exporter | None:
    """Return the exporter of a format; None, with the reason in the report, where it is not to be had."""
    if form not in EXPORTERS.names():
        if _may_be_format(form):
            reason = "no export format of this installation"
            _leave_out(form, reason, f"{reason}; install the package that adds it", report)
        else:
            report.problems.append(f"{MANIFEST}: names a format that no bundle has: {escape_line(form)!r}")
        return None
    try:
        return EXPORTERS.get(form)()
    except SwarmwrightError as error:  # of a package that cannot be imported
        _leave_out(form, "cannot be loaded", str(error), report)
        return None


def _leave_out(form: str, short: str, reason: str, report: BundleVerification) -> None:
    report.unverified[form], report.formats_not_checked[form] = reason, short


def _run_form(
    form: str, exporter: Exporter, subject: Subject, prefix: str, again: Files, report: BundleVerification
) -> None:
    """Run what the controller is exported as, which the bundle has, too."""
    try:
        found = verify(exporter, subject, prefix, again)
    except InputError as error:  # no compiler
        report.unverified[form] = str(error)
        return
    except RunError as error:
        report.problems.append(f"{form}: {error}")
        return
    report.forms[form] = found
    if not found.ok:
        report.problems.append(f"{form}: {found.words}")
