import logging
import subprocess
import sys
from pathlib import Path

import pytest

from swarmwright import Experiment, InputError, optimize
from swarmwright.runs.optimization import memory


def large(population: int, hidden: int, **method: object) -> Experiment:
    return Experiment.from_mapping(
        {
            "simulation": "minisim",
            "controller": {"hidden": [hidden, hidden]},
            "method": {"population": population, **method},
            "servers": "local",
        }
    )


def test_what_cannot_fit_is_refused_at_once(tmp_path: Path) -> None:
    with pytest.raises(
        InputError,
        match=r"population: 10,000,000 genomes of .* genes need too much memory; use at most 9,659",
    ):
        optimize(large(10_000_000, 640), out=tmp_path / "run")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("free", "level", "said"),
    [
        (10**12, logging.INFO, "MB of memory and some time"),
        (30_000_000, logging.WARNING, "but only 30 MB are available; reduce the population"),
        (None, logging.INFO, "of memory and some time"),
    ],
)
def test_it_is_said_how_much_is_needed(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, free: int | None, level: int, said: str
) -> None:
    monkeypatch.setattr(memory, "measure_available_bytes", lambda: free)
    experiment = large(200_000, 2)
    with caplog.at_level(logging.INFO, "swarmwright.progress"):
        memory.check_memory(experiment, experiment.representation())
    (record,) = caplog.records
    assert record.levelno == level
    assert said in record.getMessage()
    assert record.getMessage().startswith("200,000 candidates with 19 genes each need ")


@pytest.mark.slow
def test_limits_of_the_process_count() -> None:
    code = "from swarmwright.runs.optimization import memory; print(memory.measure_available_bytes())"
    command = f'ulimit -v 4000000; exec "{sys.executable}" -c "{code}"'
    found = subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=True, timeout=50)
    assert 0 < int(found.stdout) < 4_000_000 * 1024


def test_small_populations_and_steady_state_are_no_matter(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, "swarmwright.progress"):
        for experiment in (large(50, 2), large(200_000, 2, operation="steady_state")):
            memory.check_memory(experiment, experiment.representation())
    assert not caplog.records


def test_sizes_are_told_as_people_read_them() -> None:
    assert [memory.format_bytes(count) for count in (7, 1500, 3_940_000_000, 12 * 10**15)] == [
        "7 bytes", "1.5 kB", "3.94 GB", "12,000 TB",
    ]  # fmt: skip


def test_the_system_says_what_is_available() -> None:
    found = memory.measure_available_bytes()
    assert found is None or 0 <= found < 2**50
