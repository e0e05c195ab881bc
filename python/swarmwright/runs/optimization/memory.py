"""Check whether the candidates of a generation fit into memory, before they are made."""

import logging
import resource
from contextlib import suppress
from pathlib import Path

from swarmwright.common.errors import InputError
from swarmwright.controllers import Representation
from swarmwright.experiment.derived import fitness_expression
from swarmwright.experiment.experiment import Experiment

LARGE_POPULATION = 100_000
"""Candidates of a generation from which on slow steps are logged."""
_COPIES = 4  # of each genome at a time: asked for, its weights, the method's, the record's
_OTHER_BYTES = 200
"""Bytes of a candidate without its genes and results."""
progress = logging.getLogger("swarmwright.progress")
"""Logger of slow steps; the command line shows it, other programs may."""


def check_memory(experiment: Experiment, representation: Representation) -> None:
    """Log how much memory a large population needs, and how much there is.

    Raises InputError when not even the genomes fit.
    """
    count = candidates(experiment)
    if count < LARGE_POPULATION:
        return
    episodes = _numbers(experiment)
    genomes = count * representation.genome_size * 4
    needed = _COPIES * genomes + count * (16 * episodes + _OTHER_BYTES)
    free = available()
    what = f"{count:,} candidates with {representation.genome_size:,} genes each"
    if free is None:
        progress.info("%s: this takes about %s of memory, and a while", what, size(needed))
        return
    if genomes > free:
        raise InputError(
            f"method.population: {what} do not fit into memory: the genomes alone are {size(genomes)}, and "
            f"{size(free)} are available; take a smaller population"
        )
    if needed <= free:
        progress.info("%s: this takes about %s of memory, and a while", what, size(needed))
        return
    progress.warning(
        "%s: about %s of memory is needed, but %s are available; take a smaller population if the run ends "
        "early",
        *(what, size(needed), size(free)),
    )


def stored(experiment: Experiment, representation: Representation) -> int:
    """Return how many bytes of numbers the first generation has in the store."""
    return candidates(experiment) * (8 + 8 * _numbers(experiment) + 4 * representation.genome_size)


def candidates(experiment: Experiment) -> int:
    """Return how many candidates the first generation has, 0 where the experiment does not say."""
    options = experiment.method
    population = getattr(options, "population", None)
    if not isinstance(population, int) or options.operation == "steady_state":
        return 0
    return population * int(getattr(options, "populations", 1))


def _numbers(experiment: Experiment) -> int:
    """Return how many numbers come out of a candidate's evaluation."""
    expression = fitness_expression(experiment)
    return experiment.ranking.episodes * (1 + (0 if expression is None else len(expression.metrics)))


def available() -> int | None:
    """Return how many bytes of memory are available to this process; None where that is not known."""
    found = []
    with suppress(OSError, ValueError, KeyError):
        found.append(_table(Path("/proc/meminfo"))["MemAvailable:"] * 1024)
    for folder, most, used, files in (
        ("/sys/fs/cgroup", "memory.max", "memory.current", "inactive_file"),
        ("/sys/fs/cgroup/memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
    ):
        group = Path(folder)
        with suppress(OSError, ValueError, KeyError):  # ValueError: "max", there is no limit
            limit = int((group / most).read_text())
            # The page cache is released when needed.
            held = int((group / used).read_text()) - _table(group / "memory.stat")[files]
            found.append(max(limit - held, 0))
    largest = resource.getrlimit(resource.RLIMIT_AS)[0]  # ulimit -v
    if largest != resource.RLIM_INFINITY:
        with suppress(OSError, ValueError, IndexError):
            pages = int(Path("/proc/self/statm").read_text().split()[0])
            found.append(max(largest - pages * resource.getpagesize(), 0))
    return min(found, default=None)


def _table(file: Path) -> dict[str, int]:
    """Return lines of a name and a number."""
    rows = (line.split() for line in file.read_text().splitlines())
    return {row[0]: int(row[1]) for row in rows}


def size(count: int) -> str:
    """Return bytes as text: 3.9 GB."""
    value = float(count)
    for unit in ("bytes", "kB", "MB", "GB", "TB"):
        if value < 1000 or unit == "TB":
            break
        value /= 1000
    return f"{value:.3g} {unit}" if value < 1000 else f"{value:,.0f} {unit}"
