"""What the check of a bundle found, and how that is said."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from swarmwright.export.verification import Verification


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
        return max((one.largest_difference for one in self.forms.values()), default=0.0)

    def to_mapping(self) -> dict[str, Any]:
        """Return the report as plain values."""
        return {
            "ok": self.ok,
            "fitness_checked": not self.fitness_not_checked,
            "digest": self.digest,
            "files": self.files,
            "forms": {name: one.to_mapping() for name, one in self.forms.items()},
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
