"""Messages about the fitness of a run's best on held-out seeds."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from swarmwright import PostEvaluation


def unseen_words(found: "PostEvaluation") -> str:
    """Return a line: the fitness by which it was chosen beside that on held-out seeds."""
    episodes = f"{len(found.episodes)} episodes with held-out seeds"
    failed = f", of which {found.failed} failed" if found.failed else ""
    fitness = found.fitness
    return (
        f"Best {found.recorded + 0.0:.6g} on the seeds it was chosen on; "
        f"{with_error(fitness.mean, fitness.standard_error)} on {episodes}{failed}"
    )


def with_error(mean: float, error: float | None) -> str:
    """Return a mean with its standard error: 7.81 +- 0.31."""
    return f"{mean + 0.0:.4g}" + ("" if error is None else f" +- {error:.2g}")


def unseen_facts(found: "PostEvaluation") -> dict[str, Any]:
    """Return plain values for `--json`."""
    fitness = found.fitness
    return {
        "fitness": fitness.mean,
        "standard_error": fitness.standard_error,
        "low": fitness.low,
        "high": fitness.high,
        "episodes": len(found.episodes),
        "failed": found.failed,
        "seed": found.seeds[0],
    }
