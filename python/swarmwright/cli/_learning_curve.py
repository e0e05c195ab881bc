"""What `swarmwright evaluate --curve` shows."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from swarmwright.cli._output import Output

if TYPE_CHECKING:
    from swarmwright import Experiment, Run
    from swarmwright.cli._parameter_types import Servers


def show_learning_curve(
    output: Output,
    run: "Run",
    points: int,
    file: Path | None,
    episodes: int | None,
    seed: int | None,
    experiment: "Experiment",
    settings: Sequence[str],
    where: "tuple[str | None, Servers | None]",
) -> int:
    """Evaluate a learning curve, print it as a table, and draw or write it into a file if one is given."""
    from swarmwright import learning_curve
    from swarmwright.cli._progress import episodes as shown_episodes
    from swarmwright.runs.post_evaluation import EPISODES

    broker, servers = where
    with shown_episodes(output) as on_progress:
        curve = learning_curve(
            run,
            points,
            episodes=episodes or EPISODES,
            seed=seed,
            experiment=experiment,
            broker=broker,
            servers=servers,
            on_progress=on_progress,
        )
    if file is not None:
        (curve.export if file.suffix.lower() == ".csv" else curve.plot)(file)
    output.json(
        {**curve.to_mapping(), "settings": list(settings), "file": None if file is None else str(file)}
    )
    first, last, count = curve.seeds[0], curve.seeds[-1], len(curve.seeds)
    seeds = f"seed {first}" if count == 1 else f"seeds {first} to {last}"
    output.text(f"The {run.best_words}, in {count} episode{'s' * (count > 1)} with the {seeds}:")
    output.text("generation  evaluations   candidate     recorded     held-out  95 % interval")
    for one in curve.points:
        best = one.best.fitness
        interval = "" if best.low is None else f"  {best.low:.5g} to {best.high:.5g}"
        failed = f", {one.best.failed} failed" if one.best.failed else ""
        output.text(
            f"{one.generation:>10}{one.evaluations:>13,}{one.best.label:>12}"
            f"{one.best.recorded + 0.0:>13.5g}{best.mean + 0.0:>13.5g}{interval}{failed}"
        )
    if not curve.is_reportable:
        output.text(
            "Means leave failed episodes out and are not to be reported; --set ranking.failed=NUMBER gives "
            "these a fitness."
        )
    if file is not None:
        output.text(f"The {'table' if file.suffix.lower() == '.csv' else 'figure'} is in {file}")
    return 0
