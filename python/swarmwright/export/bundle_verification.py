"""Checking a bundle that somebody hands over: its files, its formats, and the fitness that it states."""

import hashlib
import math
import re
from collections.abc import Mapping
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

from swarmwright.common.arguments import checked
from swarmwright.common.errors import InputError, RunError, SwarmwrightError
from swarmwright.common.json_text import loads
from swarmwright.common.modules import PYTHON_KIND
from swarmwright.common.untrusted import one_line
from swarmwright.controllers.source.text import check_prefix
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
from swarmwright.export.bundle_fitness import check_episodes, check_fitness
from swarmwright.export.bundle_reading import read_files
from swarmwright.export.bundle_report import BundleVerification
from swarmwright.export.sequences import Sequences, difference
from swarmwright.export.subject import Subject
from swarmwright.export.verification import verify

_KNOWN = frozenset({MANIFEST, CONTROLLER, EVALUATION, EPISODES, LICENSE, MAPPING})
"""Files beside those in the folders of formats."""
_FORMAT_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")
"""What a format of a package that is not installed here may be called: it is a folder, also on Windows."""


@checked
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
        _check_form(str(form), prefix, subject, files, report, by=one_line(str(manifest["swarmwright"])))
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
    speed, base = (float(one) for one in value)
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
            report.problems.append(f"{MANIFEST}: names a format that no bundle has: {one_line(form)!r}")
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
