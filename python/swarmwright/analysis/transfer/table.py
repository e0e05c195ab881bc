"""A transfer as text and as plain values."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmwright.analysis.table import columns, number, pair_mapping, pairs_table
from swarmwright.common.untrusted import escape_line

if TYPE_CHECKING:
    from swarmwright.analysis.transfer.result import Transfer
    from swarmwright.common.statistics import Correlation, Estimate
    from swarmwright.runs.transfer.transferred import Transferred

_CANDIDATES = 15
"""Largest number of printed candidates per run; the plain values and the table of episodes have all."""


def table(transfer: "Transfer") -> str:
    """Return a table for each target, then one of the groups, then notes."""
    lines = list(_format_run(transfer) if len(transfer.runs) == len(transfer.targets) else _runs(transfer))
    if len(transfer.group_losses) > 1:
        lines += ["", *_groups(transfer)]
    return "\n".join([*lines, *(f"Note: {escape_line(note)}." for note in transfer.notes)])


def _format_run(transfer: "Transfer") -> Iterator[str]:
    """Yield lines with the candidates of a run."""
    count = len(transfer.seeds)
    yield f"Mean fitness of {count} episodes with held-out seeds, and what is lost (95 % interval):"
    for run in transfer.runs:
        rows = [["candidate", "recorded", "fitness", f"in {run.target}", "loss", "95 % interval"]]
        shown = zip(run.candidates, run.source_fitness, run.target_fitness, run.losses, strict=True)
        for candidate, source, target, lost in list(shown)[:_CANDIDATES]:
            recorded = "" if candidate.recorded is None else number(candidate.recorded)
            rows.append(
                [
                    candidate.label,
                    recorded,
                    *map(number, (source.mean, target.mean, lost.mean)),
                    _interval(lost),
                ]
            )
        yield ""
        yield from columns(rows)
        hidden = len(run.candidates) - len(rows) + 1
        if hidden:
            yield f"and {hidden} more; --csv and --json have all"
        if run.correlation is not None:
            yield (
                f"Rank correlation of the {run.correlation.candidates} candidates (Spearman): "
                f"{_correlation(run.correlation)}"
            )


def _runs(transfer: "Transfer") -> Iterator[str]:
    """Yield lines with the best candidate of each run."""
    count = len(transfer.seeds)
    yield (
        f"Mean fitness of the best candidate of each run in {count} episodes with held-out seeds, and what "
        "it loses (95 % interval):"
    )
    for target in transfer.targets:
        rows = [["run", "fitness", f"in {target}", "loss", "95 % interval", "rank correlation"]]
        rows += [_make_row(run) for run in transfer.runs if run.target == target]
        yield ""
        yield from columns(rows)


def _make_row(transferred: "Transferred") -> list[str]:
    numbers = (
        transferred.source_fitness[0].mean,
        transferred.target_fitness[0].mean,
        transferred.losses[0].mean,
    )
    order = "" if transferred.correlation is None else _correlation(transferred.correlation)
    return [str(transferred.run.path), *map(number, numbers), _interval(transferred.losses[0]), order]


def _groups(transfer: "Transfer") -> Iterator[str]:
    """Yield lines with the losses of each task's groups, and the tests between them."""
    several = len(transfer.tasks) > len(transfer.targets)
    for index, task in enumerate(transfer.tasks):
        if index:
            yield ""
        if several:
            yield f"Task: {escape_line(task.label)}"
        yield "Medians of the runs' best:"
        rows = [["group", "runs", "fitness", f"in {task.target}", "loss", "quartiles of the loss"]]
        for group in task.groups:
            low, high = np.quantile(group.losses, [0.25, 0.75])
            medians = (
                float(np.median(values))
                for values in (group.source_fitness, group.target_fitness, group.losses)
            )
            row = [group.label, str(len(group.losses)), *map(number, medians)]
            rows.append([*row, f"{number(low)} to {number(high)}"])
        yield from columns(rows)
        if task.pairs:
            yield ""
            yield from pairs_table(task.pairs, quantity=" of the loss")
    if several:
        yield ""


def _interval(estimate: "Estimate") -> str:
    if estimate.low is None or estimate.high is None:
        return ""
    return f"{number(estimate.low)} to {number(estimate.high)}"


def _correlation(correlation: "Correlation") -> str:
    if correlation.low is None or correlation.high is None:
        return f"{correlation.rho:.2f}"
    return f"{correlation.rho:.2f} ({correlation.low:.2f} to {correlation.high:.2f})"


def to_mapping(transfer: "Transfer") -> dict[str, Any]:
    """Return a transfer as plain values; NaN is not converted."""
    return {
        "seeds": list(transfer.seeds),
        "targets": list(transfer.targets),
        "runs": [
            {
                "run": str(run.run.path),
                "target": run.target,
                "failed": run.failed,
                "failed_in_own_simulation": run.source_failed,
                "rank_correlation": None if run.correlation is None else vars(run.correlation),
                "candidates": [
                    {
                        "generation": candidate.generation,
                        "candidate": candidate.candidate,
                        "recorded": candidate.recorded,
                        "fitness": vars(source),
                        "fitness_in_target": vars(target),
                        "loss": vars(lost),
                    }
                    for candidate, source, target, lost in zip(
                        run.candidates, run.source_fitness, run.target_fitness, run.losses, strict=True
                    )
                ],
            }
            for run in transfer.runs
        ],
        "group_losses": [
            {
                "label": group_loss.label,
                "target": group_loss.target,
                "fitness": group_loss.source_fitness.tolist(),
                "fitness_in_target": group_loss.target_fitness.tolist(),
                "loss": group_loss.losses.tolist(),
            }
            for group_loss in transfer.group_losses
        ],
        "tasks": [
            {
                "label": task.label,
                "differs": task.differs,
                "target": task.target,
                "groups": [group.label for group in task.groups],
            }
            for task in transfer.tasks
        ],
        "pairs": [{**pair_mapping(pair), "target": pair.first.target} for pair in transfer.pairs],
        "notes": list(transfer.notes),
    }
