"""Verification of untrusted bundles: their files, formats, and stated fitness."""

import hashlib
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from swarmwright.common.archives import CONTROLLER, EVALUATION, FORMAT, MANIFEST, read_files
from swarmwright.common.arguments import check_arguments
from swarmwright.common.errors import InputError, RunError, SwarmwrightError
from swarmwright.common.json_text import loads
from swarmwright.common.untrusted import escape_line
from swarmwright.controllers.modules.grammar import PYTHON_KIND
from swarmwright.controllers.source.text import check_prefix
from swarmwright.experiment.experiment import build_recorded_experiment
from swarmwright.export import EXPORTERS
from swarmwright.export._base import Exporter, Files, NotInstalledError, file_bytes
from swarmwright.export.bundle import EPISODES, LICENSE, MAPPING, parse_episodes
from swarmwright.export.sequences import Sequences, measure_difference
from swarmwright.export.subject import Subject, fitness_words
from swarmwright.export.verification import Verification, verify


@dataclass(repr=False)
class BundleVerification:
    """The result of verifying a bundle."""

    file: Path
    digest: str
    """SHA-256 of the manifest in hexadecimal, to compare with that of the sender."""
    facts: list[tuple[str, str]]
    """Origin of the controller as pairs of name and text."""
    files: int
    """Number of files that match the manifest."""
    forms: dict[str, Verification] = field(default_factory=dict)
    """Export format -> comparison with the engine's controller."""
    unverified: dict[str, str] = field(default_factory=dict)
    """Export format -> reason why it was not run; `fitness`: why it was not compared with its episodes."""
    formats_not_checked: dict[str, str] = field(default_factory=dict)
    """Export format -> short reason why its files could not be checked, such as "written by
    Swarmwright 9.9". Other formats in `unverified` have the files that this version exports."""
    episodes: int = 0
    """Number of episodes in which the controller was evaluated again."""
    not_evaluated: str = ""
    """Reason why it was not evaluated again, such as a custom simulation; empty if it was."""
    problems: list[str] = field(default_factory=list)
    """Differences from the stated content."""

    def __repr__(self) -> str:
        """Name the bundle and its result."""
        return f"<BundleVerification of {self.file}: {self}>"

    def __str__(self) -> str:
        """Return a line with the result, the largest difference, and the unchecked parts."""
        return _format_result(self)

    @property
    def ok(self) -> bool:
        """Whether all checks passed."""
        return not self.problems

    @property
    def fitness_not_checked(self) -> str:
        """Reason why the stated fitness was not checked; empty if it was."""
        return self.not_evaluated or self.unverified.get("fitness", "")

    @property
    def largest_difference(self) -> float:
        """Largest absolute difference of actuators in all formats that were run."""
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


def _format_result(report: BundleVerification) -> str:
    """Return a line with the result, the largest difference, and the unchecked parts."""
    if not report.ok:
        many = len(report.problems)
        return f"FAILED: {many} problem{'s' if many > 1 else ''}"
    unchecked = report.fitness_not_checked
    if report.formats_not_checked:
        return _format_partial_result(report, unchecked)
    if not report.forms:
        if unchecked:
            return f"Not verified: no exported code was run, and the fitness was not checked: {unchecked}"
        return "Fitness verified; no exported code was run"
    differences = f"largest difference {report.largest_difference:.3g} ({', '.join(report.forms)})"
    if unchecked:
        return f"Controller code verified: {differences}; its fitness was not checked: {unchecked}"
    return f"Verified: {differences}"


def _format_partial_result(report: BundleVerification, fitness: str) -> str:
    """Return the line if formats were not checked; fitness: why the fitness was not checked, or empty."""
    by_reason: dict[str, list[str]] = {}
    for form, reason in report.formats_not_checked.items():
        by_reason.setdefault(reason, []).append(form)
    if fitness:
        by_reason.setdefault(fitness, []).append("the fitness")
    rest = "not checked: " + ", ".join(
        f"{', '.join(parts)} ({reason})" for reason, parts in by_reason.items()
    )
    if report.forms:
        return f"Controller code verified in part: {', '.join(report.forms)}; {rest}"
    begin = "Not verified" if fitness else "Fitness verified"
    return f"{begin}; no exported code was run; {rest}"


def check_fitness(
    evaluation: Mapping[str, Any], facts: Mapping[str, str], report: BundleVerification
) -> None:
    """Compare the stated fitness with the fitness of the stated results, and with the facts."""
    from swarmwright.runs.instances import fitness_of, meaning  # noqa: PLC0415 - loads the engine

    stated = float(evaluation["fitness"])
    parts = [earlier["episodes"] for earlier in [*evaluation.get("earlier", []), evaluation]]
    try:
        experiment = build_recorded_experiment(evaluation["experiment"])
    except SwarmwrightError as error:  # a plug-in is missing
        report.unverified["fitness"] = str(error)
        return
    computed = None
    if all(result is not None for part in parts for result in part):
        computed = fitness_of(experiment, parts)
    if computed is None:
        report.unverified["fitness"] = "its ranking uses more than these episodes"
    elif not math.isclose(computed, stated, rel_tol=1e-12, abs_tol=0.0):
        report.problems.append(f"{EVALUATION}: the fitness is {stated!r}, but its episodes give {computed!r}")
    expected_words = fitness_words(stated, meaning(experiment, len(parts)))
    if "Fitness" in facts and facts["Fitness"] not in (expected_words, repr(stated + 0.0)):
        report.problems.append(
            f"{MANIFEST}: the fitness is {escape_line(facts['Fitness'])!r}, but in {EVALUATION} "
            f"{expected_words!r}"
        )


def check_episodes(evaluation: Mapping[str, Any], subject: Subject, report: BundleVerification) -> None:
    """Evaluate the controller in the episodes of the run and in those with held-out seeds."""
    from swarmwright.simulations import catalogue  # noqa: PLC0415 - loads the engine

    group = evaluation.get("group")
    if group is not None:
        report.not_evaluated = f"it is that of all groups together, not of {escape_line(str(group))} alone"
        return
    simulation = evaluation["experiment"].get("simulation")
    if simulation not in catalogue.titles():
        report.not_evaluated = f"the simulation {escape_line(str(simulation))} is not built in"
        return
    earlier = [(part["seeds"], part["episodes"]) for part in evaluation.get("earlier", [])]
    stated = [*earlier, (evaluation["seeds"], evaluation["episodes"])]
    if evaluation["held_out"] is not None:
        stated.append((evaluation["held_out"]["seeds"], evaluation["held_out"]["episodes"]))
    for seeds, episodes in stated:
        try:
            computed = _episode_fitness(evaluation["experiment"], subject, [int(seed) for seed in seeds])
        except SwarmwrightError as error:
            report.not_evaluated = str(error)
            return
        report.episodes += len(seeds)
        for seed, value, result in zip(seeds, episodes, computed, strict=True):
            if not _is_same(value, result):
                report.problems.append(
                    f"{EVALUATION}: the fitness in the episode with seed {seed} is {result!r}, not {value}"
                )


def _is_same(stated: float | None, computed: float) -> bool:
    return math.isnan(computed) if stated is None else stated == computed


def _episode_fitness(values: Mapping[str, Any], subject: Subject, seeds: list[int]) -> list[float]:
    from swarmwright.experiment.experiment import Experiment  # noqa: PLC0415 - loads the engine
    from swarmwright.servers.evaluation.base import Controllers  # noqa: PLC0415 - loads the engine
    from swarmwright.servers.evaluation.opening import open_backend  # noqa: PLC0415 - loads the engine

    experiment = Experiment.from_mapping(dict(values))
    architecture = {**subject.specification, "weights": []}
    weights = np.array(subject.specification["weights"], dtype=np.float32)[np.newaxis]
    with open_backend(experiment, servers="in-process") as backend:
        results = backend.evaluate(Controllers(architecture, weights), seeds, lambda *_: None)
    fitness: list[float] = results.fitness[0].tolist()
    return fitness


_KNOWN = frozenset({MANIFEST, CONTROLLER, EVALUATION, EPISODES, LICENSE, MAPPING})
"""Files outside the folders of formats."""
_FORMAT_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")
"""Valid names of formats from packages that are not installed: folders, also on Windows."""


@check_arguments
def verify_bundle(file: str | PathLike[str]) -> BundleVerification:
    """Verify an untrusted bundle; none of its content is executed unless this version exports the same.

    Every file must match the manifest and belong to a bundle. The engine's controller must compute the
    recorded actuators in the recorded episodes, and in a built-in simulation, it must reach the stated
    fitness; otherwise `fitness_not_checked` has the reason. Each export format is exported again from the
    specification. If the files are the same, they are compiled and run as by `export --verify`. Different
    files are not run: they were changed, or written by another version of Swarmwright; `formats_not_checked`
    lists the latter, and formats of packages that are not installed. A file name that this version does not
    export is always a problem.

    Args:
        file: the archive, or its unpacked folder.

    Raises InputError when it is not a bundle, has a newer format, or has files that may be unpacked outside
    its
    folder: absolute names, names with `..`, backslashes or drive letters, links.

    Examples:
        >>> bundle = swarmwright.export_bundle("result", "gather.zip")
        >>> swarmwright.verify_bundle(bundle.file).problems
        []

    See also: `export_bundle`, which writes the archive.
    """
    path = Path(file)
    files = read_files(path)
    try:
        return _verify_files(path, files)
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        raise InputError(f"{path}: {MANIFEST}, or a file named in it, is invalid: {error}") from None


def _verify_files(path: Path, files: dict[str, bytes]) -> BundleVerification:
    manifest = loads(files[MANIFEST])
    if not isinstance(manifest, Mapping) or not isinstance(manifest.get("format"), int):
        raise InputError(f"{path}: {MANIFEST}: the format is missing; this is not a bundle of Swarmwright")
    if manifest["format"] != FORMAT:
        raise InputError(
            f"{path}: has the format {manifest['format']}, of Swarmwright {manifest.get('swarmwright')}; "
            f"this version reads {FORMAT}"
        )
    digest = hashlib.sha256(files[MANIFEST]).hexdigest()
    facts = [(str(name), str(text)) for name, text in manifest["facts"]]
    report = BundleVerification(path, digest, facts, 0)
    _compare_files(manifest, files, report)
    if not report.ok:  # changed files are not used
        return report
    subject = _subject(manifest, files, facts, report)
    prefix = str(manifest["prefix"])
    check_prefix(prefix)
    for form in manifest["forms"]:
        _check_form(
            str(form),
            prefix,
            subject,
            files,
            report,
            author_version=escape_line(str(manifest["swarmwright"])),
        )
    evaluation = loads(files[EVALUATION])
    check_fitness(evaluation, dict(facts), report)
    check_episodes(evaluation, subject, report)
    return report


def _compare_files(manifest: Mapping[str, Any], files: dict[str, bytes], report: BundleVerification) -> None:
    """Report files that do not match the manifest or do not belong to a bundle, once each."""
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
            report.problems.append(f"{name}: was changed; its SHA-256 differs from the manifest's")
        elif name not in _KNOWN and ("/" not in name or name.partition("/")[0] not in folders):
            report.problems.append(f"{name}: is not a file of a bundle of this version")
        else:
            report.files += 1


def _may_be_format(form: str) -> bool:
    """Whether a format is registered, or may belong to a package that is not installed."""
    registered = EXPORTERS.names()
    # Some file systems do not distinguish C and c.
    return form in registered or bool(_FORMAT_NAME.fullmatch(form) and form.lower() not in registered)


def _subject(
    manifest: Mapping[str, Any],
    files: dict[str, bytes],
    facts: list[tuple[str, str]],
    report: BundleVerification,
) -> Subject:
    """Return the controller, with episodes that were compared with the engine's controller."""
    from swarmwright.controllers.controller import Controller  # noqa: PLC0415 - loads the engine

    specification = loads(files[CONTROLLER])
    if specification.get("kind") == PYTHON_KIND:
        raise InputError(
            f"{CONTROLLER}: the controller has modules in Python, but verify does not execute code of an "
            "archive; if you trust the sender, run the self-test in the folder python"
        )
    controller = Controller(specification)
    description, recorded = dict(manifest["description"]), manifest["episodes"]
    if "sensors" not in specification:
        return Subject(
            specification, tuple(facts), values=controller.parameters, ranges=dict(manifest["ranges"])
        )
    episodes = None
    if EPISODES in files:
        episodes = parse_episodes(
            files[EPISODES].decode(), int(specification["sensors"]), int(specification["actuators"])
        )
        if len(episodes):
            expected = Sequences.compute(specification, episodes.first, episodes.sensors, episodes.accepted)
            episodes = replace(episodes, may_overflow=expected.may_overflow)
            largest, differing = measure_difference(expected, episodes.actuators)
            if differing:
                report.problems.append(
                    f"{EPISODES}: {differing:,} actuators differ from those of the controller, by up to "
                    f"{largest:.3g}"
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


def _wheels(value: Any) -> tuple[float, float]:  # noqa: ANN401 - from the manifest
    """Parse speed and distance of wheels, 0 if unknown. Raises ValueError for invalid values."""
    speed, base = (float(number) for number in value)
    if not (math.isfinite(speed) and math.isfinite(base) and speed >= 0 and base >= 0):
        raise ValueError(f"wheels: must be two finite numbers of at least 0, not {value}")
    return speed, base


_LONGEST_STEP_S = 1e38
"""Largest step in seconds, which headers store as a 32-bit float."""


def _seconds(key: str, manifest: Mapping[str, Any]) -> float:
    """Parse the duration of a step, 0 if unknown. Raises ValueError for invalid values."""
    step = float(manifest.get(key, 0.0))
    if not 0 <= step <= _LONGEST_STEP_S:
        raise ValueError(f"{key}: must be a number from 0 to {_LONGEST_STEP_S:g}, not {step}")
    return step


def _check_form(
    form: str,
    prefix: str,
    subject: Subject,
    files: dict[str, bytes],
    report: BundleVerification,
    *,
    author_version: str,
) -> None:
    """Compare a format's files with a new export, and run them; author_version: version that wrote them."""
    from swarmwright import __version__  # noqa: PLC0415 - asks the engine

    exporter = _exporter(form, report)
    if exporter is None:
        return
    hint = (
        ""
        if author_version == __version__
        else f"; verify it with Swarmwright {author_version}, which wrote it"
    )
    try:
        exporter = exporter.portable()
        exported: Files = exporter.files(subject, prefix)
    except NotInstalledError as error:
        _skip_form(form, "a package is not installed", str(error), report)
        return
    except SwarmwrightError as error:
        report.problems.append(f"{form}: this controller cannot be exported to this format: {error}{hint}")
        return
    bundled = {
        name.removeprefix(f"{form}/"): data for name, data in files.items() if name.startswith(f"{form}/")
    }
    foreign = sorted(bundled.keys() - exported.keys())
    if foreign:
        report.problems += [f"{form}/{name}: is not exported by this version{hint}" for name in foreign]
        return
    if bundled != {name: file_bytes(content) for name, content in exported.items()}:
        if author_version == __version__:
            report.problems.append(f"{form}: its files differ from an export of the controller")
        else:
            reason = (
                f"written by Swarmwright {author_version}; "
                f"this version, {__version__}, exports it differently"
            )
            _skip_form(form, f"written by Swarmwright {author_version}", reason, report)
        return
    _run_form(form, exporter, subject, prefix, exported, report)


def _exporter(form: str, report: BundleVerification) -> Exporter | None:
    """Return the exporter of a format; None, with the reason in the report, if it is unavailable."""
    if form not in EXPORTERS.names():
        if _may_be_format(form):
            reason = "not an export format of this installation"
            _skip_form(form, reason, f"{reason}; install the package that adds it", report)
        else:
            report.problems.append(f"{MANIFEST}: invalid format {escape_line(form)!r}")
        return None
    try:
        return EXPORTERS.get(form)()
    except SwarmwrightError as error:  # of a package that cannot be imported
        _skip_form(form, "cannot be loaded", str(error), report)
        return None


def _skip_form(form: str, short: str, reason: str, report: BundleVerification) -> None:
    report.unverified[form], report.formats_not_checked[form] = reason, short


def _run_form(
    form: str, exporter: Exporter, subject: Subject, prefix: str, exported: Files, report: BundleVerification
) -> None:
    """Run the exported controller, whose files are those of the bundle."""
    try:
        verification = verify(exporter, subject, prefix, exported)
    except InputError as error:  # no compiler
        report.unverified[form] = str(error)
        return
    except RunError as error:
        report.problems.append(f"{form}: {error}")
        return
    report.forms[form] = verification
    if not verification.ok:
        report.problems.append(f"{form}: {verification.words}")
