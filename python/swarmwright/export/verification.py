"""Exported controllers compared with the engine's, in random sequences and in episodes of the simulation."""

from dataclasses import dataclass
from typing import Any

from swarmwright.common.temporary import TemporaryFolder
from swarmwright.export._base import Exporter, Files, file_bytes
from swarmwright.export.sequences import RANDOM_SEQUENCES, difference, random_sequences
from swarmwright.export.subject import Subject


@dataclass(frozen=True)
class Verification:
    """How far what was exported is what the simulation ran."""

    largest_difference: float
    """Between actuators, absolute; 0 for a parameter set whose values are right."""
    differing: int
    """Actuators whose bits differ."""
    tolerance: float
    """What is promised; 0 for the same bits."""
    random_sequences: int
    random_steps: int
    episodes: int
    episode_steps: int
    """Sensor-actuator exchanges of all agents in the recorded episodes."""
    without_episodes: str
    """Why there are none; empty where there are."""
    self_test: str | None
    """The generated self-test, which was run; None where there is none."""
    untried: str = ""
    """What of the format is neither compiled nor run; empty where that is nothing."""

    @property
    def ok(self) -> bool:
        """Whether what is promised holds."""
        return self.differing == 0 if self.tolerance == 0 else self.largest_difference <= self.tolerance

    @property
    def words(self) -> str:
        """One line, which holds the largest difference."""
        if self.differing == 0:
            said = "largest difference 0, bit-identical"
        else:
            said = f"largest difference {self.largest_difference:.3g}, {self.differing:,} actuators differ"
        if not self.ok:
            said = f"FAILED: {said}"
        elif self.tolerance and self.differing:
            said += f" by at most the {self.tolerance:g} that is promised"
        if not self.random_sequences:
            return f"{said}: every parameter has its value"
        where = f"{self.random_sequences:,} random sequences ({self.random_steps:,} steps)"
        if self.episodes:
            many = f"{self.episodes} episode{'s' if self.episodes > 1 else ''}"
            said += f" in {where} and {many} of the simulation ({self.episode_steps:,} steps of agents)"
        else:
            said += f" in {where}, without episodes of the simulation"
        return f"{said}; not compiled: {self.untried}" if self.untried else said

    def to_mapping(self) -> dict[str, Any]:
        """Return the report as plain values."""
        return {"ok": self.ok, **vars(self)}


def verify(exporter: Exporter, subject: Subject, prefix: str, files: Files) -> Verification:
    """Run what was exported, in a temporary folder.

    Raises:
        InputError: a program that this needs is not installed.
        RunError: it could not be compiled, failed, or its self-test did.
    """
    with TemporaryFolder("export") as folder:
        for name, content in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(file_bytes(content))
        if not subject.steers:
            values = exporter.values(folder, prefix)
            test = exporter.self_test(folder, prefix)
            wrong = (
                0
                if values is None
                else sum(values.get(name) != value for name, value in subject.values.items())
            )
            return Verification(float(wrong), wrong, 0.0, 0, 0, 0, 0, "", test)
        drawn = random_sequences(
            subject.specification,
            refused=exporter.refuses,
            longest=exporter.longest,
            checks_random=subject.checks_random,
        )
        found = [(drawn, exporter.run(folder, prefix, drawn))]
        episodes = subject.episodes
        if episodes is not None and len(episodes):
            found.append((episodes, exporter.run(folder, prefix, episodes)))
        test = exporter.self_test(folder, prefix)
    distances = [difference(expected, actuators) for expected, actuators in found]
    return Verification(
        max(largest for largest, _ in distances),
        sum(differing for _, differing in distances),
        exporter.tolerance,
        RANDOM_SEQUENCES,
        len(drawn),
        subject.episode_count if len(found) > 1 else 0,
        0 if episodes is None else len(episodes),
        subject.reason or ("" if len(found) > 1 else "no agent was steered in them"),
        test,
        exporter.untried,
    )
