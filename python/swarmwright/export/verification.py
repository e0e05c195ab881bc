"""Verification of exported controllers, in random sequences and in episodes of the simulation."""

from dataclasses import dataclass
from typing import Any

from swarmwright.common.temporary import TemporaryFolder
from swarmwright.export._base import Exporter, Files, file_bytes
from swarmwright.export.sequences import RANDOM_SEQUENCES, draw_random_sequences, measure_difference
from swarmwright.export.subject import Subject


@dataclass(frozen=True)
class Verification:
    """Comparison of an exported controller with the simulation."""

    largest_difference: float
    """Largest absolute difference of actuators; 0 for a parameter set with correct values."""
    differing: int
    """Number of actuators whose bits differ."""
    tolerance: float
    """Guaranteed largest difference; 0: bit-identical."""
    random_sequences: int
    random_steps: int
    episodes: int
    episode_steps: int
    """Steps of all agents in the recorded episodes."""
    without_episodes: str
    """Reason for missing episodes; empty if there are episodes."""
    self_test: str | None
    """The generated self-test, which was run; None without one."""
    untried: str = ""
    """Part that is neither compiled nor run; empty if everything is."""

    @property
    def ok(self) -> bool:
        """Whether the difference is within the tolerance."""
        return self.differing == 0 if self.tolerance == 0 else self.largest_difference <= self.tolerance

    @property
    def words(self) -> str:
        """A line with the result and the largest difference."""
        if self.differing == 0:
            result = "largest difference 0, bit-identical"
        else:
            result = f"largest difference {self.largest_difference:.3g}, {self.differing:,} actuators differ"
        if not self.ok:
            result = f"FAILED: {result}"
        elif self.tolerance and self.differing:
            result += f" by at most {self.tolerance:g}, as guaranteed"
        if not self.random_sequences:
            return f"{result}: all parameters are correct"
        sequences = f"{self.random_sequences:,} random sequences ({self.random_steps:,} steps)"
        if self.episodes:
            episodes = f"{self.episodes} episode{'s' if self.episodes > 1 else ''}"
            result += (
                f" in {sequences} and {episodes} of the simulation ({self.episode_steps:,} steps of agents)"
            )
        else:
            result += f" in {sequences}, without episodes of the simulation"
        return f"{result}; not compiled: {self.untried}" if self.untried else result

    def to_mapping(self) -> dict[str, Any]:
        """Return the report as plain values."""
        return {"ok": self.ok, **vars(self)}


def verify(exporter: Exporter, subject: Subject, prefix: str, files: Files) -> Verification:
    """Run an exported controller in a temporary folder.

    Raises:
        InputError: a required program is not installed.
        RunError: the compilation, the program or its self-test failed.
    """
    with TemporaryFolder("export") as folder:
        for name, content in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(file_bytes(content))
        if not subject.steers:
            values = exporter.values(folder, prefix)
            test = exporter.self_test(folder, prefix)
            mismatches = (
                0
                if values is None
                else sum(values.get(name) != value for name, value in subject.values.items())
            )
            return Verification(float(mismatches), mismatches, 0.0, 0, 0, 0, 0, "", test)
        drawn = draw_random_sequences(
            subject.specification,
            refused=exporter.refuses,
            longest=exporter.longest,
            checks_random=subject.checks_random,
        )
        outputs = [(drawn, exporter.run(folder, prefix, drawn))]
        episodes = subject.episodes
        if episodes is not None and len(episodes):
            outputs.append((episodes, exporter.run(folder, prefix, episodes)))
        test = exporter.self_test(folder, prefix)
    distances = [measure_difference(expected, actuators) for expected, actuators in outputs]
    return Verification(
        max(largest for largest, _ in distances),
        sum(differing for _, differing in distances),
        exporter.tolerance,
        RANDOM_SEQUENCES,
        len(drawn),
        subject.episode_count if len(outputs) > 1 else 0,
        0 if episodes is None else len(episodes),
        subject.reason or ("" if len(outputs) > 1 else "the controller steered no agent in them"),
        test,
        exporter.untried,
    )
