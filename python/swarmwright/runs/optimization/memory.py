"""Check whether the candidates of a generation fit into memory before they are created."""

import logging
import resource
from contextlib import suppress
from pathlib import Path

from swarmwright.common.errors import InputError
from swarmwright.controllers import Representation
from swarmwright.experiment.derived import fitness_expression
from swarmwright.experiment.experiment import Experiment

LARGE_POPULATION = 100_000
"""Candidates per generation from which slow steps are logged."""
_COPIES = 4  # of each genome at a time: the candidate, its weights, the method's, the record's
_OTHER_BYTES = 200
"""Bytes per candidate besides its genes and results."""
progress = logging.getLogger("swarmwright.progress")
"""Logger of slow steps; the command line shows it, other programs may."""


def check_memory(experiment: Experiment, representation: Representation) -> None:
    """Log how much memory a large population needs and how much is available.

    Raises InputError when not even the genomes fit.
    """
    count = count_candidates(experiment)
    if count < LARGE_POPULATION:
        return
    episodes = _count_results(experiment)
    genomes = count * representation.genome_size * 4
    needed = _COPIES * genomes + count * (16 * episodes + _OTHER_BYTES)
    free = measure_available_bytes()
    population = f"{count:,} candidates with {representation.genome_size:,} genes each"
    if free is not None and genomes > free:
        raise InputError(
            f"method.population: {population} do not fit into memory: the genomes alone take "
            f"{format_bytes(genomes)}, but only {format_bytes(free)} are available; reduce the population"
        )
    if free is None or needed <= free:
        progress.info("%s need about %s of memory and some time", population, format_bytes(needed))
        return
    progress.warning(
        "%s need about %s of memory, but only %s are available; reduce the population if the run is killed",
        *(population, format_bytes(needed), format_bytes(free)),
    )


def estimate_stored_bytes(experiment: Experiment, representation: Representation) -> int:
    """Estimate the bytes of numbers of the first generation in the store."""
    return count_candidates(experiment) * (
        8 + 8 * _count_results(experiment) + 4 * representation.genome_size
    )


def count_candidates(experiment: Experiment) -> int:
    """Return the number of candidates of the first generation, 0 if the experiment does not set it."""
    options = experiment.method
    population = getattr(options, "population", None)
    if not isinstance(population, int) or options.operation == "steady_state":
        return 0
    return population * int(getattr(options, "islands", 1))


def _count_results(experiment: Experiment) -> int:
    """Return the number of values that an evaluation of a candidate yields."""
    expression = fitness_expression(experiment)
    return experiment.ranking.episodes * (1 + (0 if expression is None else len(expression.metrics)))


def measure_available_bytes() -> int | None:
    """Return the bytes of memory available to this process; None if unknown."""
    limits = []
    with suppress(OSError, ValueError, KeyError):
        limits.append(_read_table(Path("/proc/meminfo"))["MemAvailable:"] * 1024)
    for folder, most, used, files in (
        ("/sys/fs/cgroup", "memory.max", "memory.current", "inactive_file"),
        ("/sys/fs/cgroup/memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
    ):
        group = Path(folder)
        with suppress(OSError, ValueError, KeyError):  # ValueError: "max", no limit
            limit = int((group / most).read_text())
            # The page cache is released when needed.
            in_use = int((group / used).read_text()) - _read_table(group / "memory.stat")[files]
            limits.append(max(limit - in_use, 0))
    largest = resource.getrlimit(resource.RLIMIT_AS)[0]  # ulimit -v
    if largest != resource.RLIM_INFINITY:
        with suppress(OSError, ValueError, IndexError):
            pages = int(Path("/proc/self/statm").read_text().split()[0])
            limits.append(max(largest - pages * resource.getpagesize(), 0))
    return min(limits, default=None)


def _read_table(file: Path) -> dict[str, int]:
    """Read a file whose lines have a name and a number."""
    rows = (line.split() for line in file.read_text().splitlines())
    return {row[0]: int(row[1]) for row in rows}


def format_bytes(count: int) -> str:
    """Format a number of bytes: 3.9 GB."""
    value = float(count)
    for unit in ("bytes", "kB", "MB", "GB", "TB"):
        if value < 1000 or unit == "TB":
            break
        value /= 1000
    return f"{value:.3g} {unit}" if value < 1000 else f"{value:,.0f} {unit}"
