"""Checking a bundle that somebody hands over: its files, its forms, and the fitness that it states."""

import hashlib
import json
import math
import zipfile
import zlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from swarmwright.core.arguments import checked
from swarmwright.core.errors import InputError, RunError, SwarmwrightError
from swarmwright.core.modules import PYTHON_KIND
from swarmwright.core.untrusted import one_line
from swarmwright.export import EXPORTERS
from swarmwright.export._base import Exporter, Files, file_bytes
from swarmwright.export.bundle import (
    CONTROLLER,
    EPISODES,
    EVALUATION,
    FORMAT,
    MANIFEST,
    episodes_of,
)
from swarmwright.export.sequences import Sequences, difference
from swarmwright.export.subject import Subject, fitness_words
from swarmwright.export.text import check_prefix
from swarmwright.export.verification import Verification, verify

_LARGEST = 1 << 28
"""Bytes of all files of a bundle."""


@dataclass
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
    """By form, how it compares with the engine's controller."""
    unverified: dict[str, str] = field(default_factory=dict)
    """By form, why it was not run; `fitness`: why it could not be compared with its episodes."""
    episodes: int = 0
    """Episodes in which the controller was evaluated again, with the fitness that is stated."""
    not_evaluated: str = ""
    """Why it was not evaluated again; empty where it was."""
    problems: list[str] = field(default_factory=list)
    """What is not as stated."""

    @property
    def ok(self) -> bool:
        """Whether all that was checked is as stated."""
        return not self.problems

    @property
    def largest_difference(self) -> float:
        """Between actuators of all forms that were run, absolute."""
        return max((one.largest_difference for one in self.forms.values()), default=0.0)

    @property
    def words(self) -> str:
        """One line, which holds the largest difference."""
        if not self.ok:
            many = len(self.problems)
            return f"FAILED: {many} problem{'s' if many > 1 else ''}"
        forms = ", ".join(self.forms) if self.forms else "no form was run"
        return f"largest difference {self.largest_difference:.3g} ({forms})"

    def to_mapping(self) -> dict[str, Any]:
        """Return the report as plain values."""
        return {
            "ok": self.ok,
            "digest": self.digest,
            "files": self.files,
            "forms": {name: one.to_mapping() for name, one in self.forms.items()},
            "unverified": self.unverified,
            "largest_difference": self.largest_difference,
            "episodes": self.episodes,
            "not_evaluated": self.not_evaluated,
            "problems": self.problems,
        }


@checked
def verify_bundle(file: str | Path) -> BundleVerification:
    """Check a bundle, wherever it comes from; nothing that it contains is executed unless it is known.

    Every file must be as its manifest says. In the recorded episodes the engine's controller must do what
    they state, and where the simulation is a built-in one, it must get the fitness that is stated. Each form
    is exported again from the specification. Where that gives the same files, they are compiled and run as by
    `export --verify`. Where it does not, they are not run: they were changed, or another version of
    Swarmwright wrote them.

    Args:
        file: the archive, or the folder that it was unpacked to.

    Raises InputError when it is not a bundle, or one of a later version.
    """
    path = Path(file)
    files = _read(path)
    try:
        return _checked(path, files)
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        raise InputError(
            f"{path}: {MANIFEST}, or what it names, is not as a bundle has it: {error}"
        ) from None


def _read(path: Path) -> dict[str, bytes]:
    if path.is_dir():
        return _read_folder(path)
    try:
        with zipfile.ZipFile(path) as archive:
            infos = [info for info in archive.infolist() if not info.is_dir()]  # other programs add folders
            _check_size(path, sum(info.file_size for info in infos))
            names = [info.filename for info in infos]
            if len(set(names)) < len(names):
                raise InputError(f"{path}: has a file twice: {one_line(_twice(names))}")
            _check_manifest(path, names)
            return {info.filename: archive.read(info) for info in infos}
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (
        zipfile.BadZipFile, zipfile.LargeZipFile, zlib.error, RuntimeError, NotImplementedError, EOFError,
    ) as error:  # fmt: skip
        raise InputError(f"{path}: is not a bundle, or is damaged: {error}") from error


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
            if file.is_symlink() or not file.is_file():
                raise InputError(f"{folder}: {one_line(name)}: is not a plain file; no bundle has others")
        _check_size(folder, sum(file.stat().st_size for file in files.values()))
        return {name: file.read_bytes() for name, file in files.items()}
    except OSError as error:
        raise InputError(f"{folder}: cannot be read: {error.strerror or error}") from error


def _check_size(path: Path, size: int) -> None:
    if size > _LARGEST:
        raise InputError(f"{path}: has more than {_LARGEST >> 20} MiB of files; no bundle is so large")


def _check_manifest(path: Path, names: Collection[str]) -> None:
    if MANIFEST not in names:
        raise InputError(
            f"{path}: is not a bundle: it has no {MANIFEST}; "
            "`swarmwright export RUN --bundle FILE.zip` makes one"
        )


def _twice(names: list[str]) -> str:
    return next(name for name in names if names.count(name) > 1)


def _checked(path: Path, files: dict[str, bytes]) -> BundleVerification:
    manifest = json.loads(files[MANIFEST])
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
        _run_form(str(form), prefix, subject, files, report, by=str(manifest["swarmwright"]))
    evaluation = json.loads(files[EVALUATION])
    _check_fitness(evaluation, dict(facts), report)
    _evaluate(evaluation, subject, report)
    return report


def _compare_files(manifest: Mapping[str, Any], files: dict[str, bytes], report: BundleVerification) -> None:
    listed = manifest["files"]
    if not isinstance(listed, Mapping):
        raise TypeError("files is not a mapping")
    for name in sorted({*files, *listed} - {MANIFEST}):
        if name not in files:
            report.problems.append(f"{name}: is missing")
        elif name not in listed:
            report.problems.append(f"{name}: is not in the manifest")
        elif hashlib.sha256(files[name]).hexdigest() != listed[name]["sha256"]:
            report.problems.append(
                f"{name}: is not what was written: its SHA-256 differs from the manifest's"
            )
        else:
            report.files += 1


def _subject(
    manifest: Mapping[str, Any],
    files: dict[str, bytes],
    facts: list[tuple[str, str]],
    report: BundleVerification,
) -> Subject:
    """Return the controller, with episodes that have been compared with what the engine's controller does."""
    from swarmwright.representations.controller import Controller  # noqa: PLC0415 - loads the engine

    specification = json.loads(files[CONTROLLER])
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
            does = Sequences.computed(specification, episodes.first, episodes.sensors)
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
        step_size=_step_size(manifest.get("step_size", 0.0)),
    )


def _step_size(value: Any) -> float:  # noqa: ANN401 - whatever the manifest says
    """Return the duration of a step, 0 where it is not known. Raises ValueError for what is none."""
    step = float(value)
    if not (math.isfinite(step) and step >= 0):
        raise ValueError(f"step_size: must be a finite number from 0 on, not {step}")
    return step


def _run_form(
    form: str, prefix: str, subject: Subject, files: dict[str, bytes], report: BundleVerification, *, by: str
) -> None:
    """Compare a form with what the controller is exported as, and run it; by: the version that wrote it."""
    from swarmwright import __version__  # noqa: PLC0415 - asks the engine

    try:
        exporter: Exporter = EXPORTERS.get(form)()
        again: Files = exporter.files(subject, prefix)
    except SwarmwrightError as error:
        report.unverified[form] = str(error)
        return
    there = {
        name.removeprefix(f"{form}/"): data for name, data in files.items() if name.startswith(f"{form}/")
    }
    if there != {name: file_bytes(content) for name, content in again.items()}:
        if by == __version__:
            report.problems.append(f"{form}: its files are not those that the controller is exported as")
        else:
            report.unverified[form] = (
                f"Swarmwright {by} wrote it; this version, {__version__}, exports the controller differently"
            )
        return
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


def _check_fitness(
    evaluation: Mapping[str, Any], facts: Mapping[str, str], report: BundleVerification
) -> None:
    """Compare the stated fitness with what the stated results make, and with what the forms say."""
    from swarmwright.experiment.experiment import Experiment  # noqa: PLC0415 - loads the engine
    from swarmwright.runs.instances import fitness_of, meaning  # noqa: PLC0415 - loads the engine

    stated = float(evaluation["fitness"])
    parts = [one["episodes"] for one in [*evaluation.get("earlier", []), evaluation]]
    try:
        experiment = Experiment.unasked(evaluation["experiment"])
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
            f"{MANIFEST}: says of the fitness {one_line(facts['Fitness'])!r}, but {EVALUATION} {said!r}"
        )


def _evaluate(evaluation: Mapping[str, Any], subject: Subject, report: BundleVerification) -> None:
    """Evaluate the controller in the episodes of the run and those with held-out seeds."""
    from swarmwright.simulations import catalogue  # noqa: PLC0415 - loads the engine

    simulation = evaluation["experiment"].get("simulation")
    if simulation not in catalogue.titles():
        report.not_evaluated = f"the simulation {one_line(str(simulation))} is not a built-in one"
        return
    earlier = [(one["seeds"], one["episodes"]) for one in evaluation.get("earlier", [])]
    stated = [*earlier, (evaluation["seeds"], evaluation["episodes"])]
    if evaluation["held_out"] is not None:
        stated.append((evaluation["held_out"]["seeds"], evaluation["held_out"]["episodes"]))
    for seeds, episodes in stated:
        try:
            found = _episodes(evaluation["experiment"], subject, [int(seed) for seed in seeds])
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


def _episodes(values: Mapping[str, Any], subject: Subject, seeds: list[int]) -> list[float]:
    from swarmwright.evaluation.base import Controllers  # noqa: PLC0415 - loads the engine
    from swarmwright.evaluation.opening import open_backend  # noqa: PLC0415 - loads the engine
    from swarmwright.experiment.experiment import Experiment  # noqa: PLC0415 - loads the engine

    experiment = Experiment.from_mapping(dict(values))
    architecture = {**subject.specification, "weights": []}
    weights = np.array(subject.specification["weights"], dtype=np.float32)[np.newaxis]
    with open_backend(experiment, servers="in-process") as backend:
        results = backend.evaluate(Controllers(architecture, weights), seeds, lambda *_: None)
    found: list[float] = results.fitness[0].tolist()
    return found
