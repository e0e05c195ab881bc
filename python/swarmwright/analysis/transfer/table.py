"""A transfer in words and as plain values."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmwright.analysis.table import columns, number
from swarmwright.core.formatting import p_value
from swarmwright.core.untrusted import one_line

if TYPE_CHECKING:
    from swarmwright.analysis.transfer.result import Transfer
    from swarmwright.core.correlation import Correlation
    from swarmwright.core.statistics import Estimate
    from swarmwright.runs.transfer.transferred import Transferred

_CANDIDATES = 15
"""Most candidates of a run that are printed; the plain values and the table of episodes have all."""
_PAIRS = 15
"""Most pairs of designs that are printed; the plain values have all."""


def table(transfer: "Transfer") -> str:
    """Return a table for each target, then one of the designs, then notes."""
    lines = list(_one_run(transfer) if len(transfer.runs) == len(transfer.targets) else _runs(transfer))
    if len(transfer.groups) > 1:
        lines += ["", *_designs(transfer)]
    return "\n".join([*lines, *(f"Note: {one_line(note)}." for note in transfer.notes)])


def _one_run(transfer: "Transfer") -> Iterator[str]:
    """Yield the candidates of a run."""
    count = len(transfer.seeds)
    yield f"Mean fitness of {count} episodes with held-out seeds, and what is lost (95 % interval):"
    for one in transfer.runs:
        rows = [["candidate", "during evolution", "fitness", f"in {one.target}", "loss", "95 % interval"]]
        shown = zip(one.candidates, one.source_fitness, one.target_fitness, one.losses, strict=True)
        for candidate, here, there, lost in list(shown)[:_CANDIDATES]:
            recorded = "" if candidate.recorded is None else number(candidate.recorded)
            rows.append(
                [candidate.label, recorded, *map(number, (here.mean, there.mean, lost.mean)), _interval(lost)]
            )
        yield ""
        yield from columns(rows)
        hidden = len(one.candidates) - len(rows) + 1
        if hidden:
            yield f"and {hidden} more; --csv and --json have all"
        if one.correlation is not None:
            yield (
                f"Rank correlation of the {one.correlation.candidates} candidates (Spearman): "
                f"{_correlation(one.correlation)}"
            )


def _runs(transfer: "Transfer") -> Iterator[str]:
    """Yield the best candidate of each run."""
    count = len(transfer.seeds)
    yield (
        f"Mean fitness of the best candidate of each run in {count} episodes with held-out seeds, and what "
        "it loses (95 % interval):"
    )
    for target in transfer.targets:
        rows = [["run", "fitness", f"in {target}", "loss", "95 % interval", "rank correlation"]]
        rows += [_of_run(one) for one in transfer.runs if one.target == target]
        yield ""
        yield from columns(rows)


def _of_run(one: "Transferred") -> list[str]:
    numbers = (one.source_fitness[0].mean, one.target_fitness[0].mean, one.losses[0].mean)
    order = "" if one.correlation is None else _correlation(one.correlation)
    return [str(one.run.path), *map(number, numbers), _interval(one.losses[0]), order]


def _designs(transfer: "Transfer") -> Iterator[str]:
    for target in transfer.targets:
        rows = [["design", "runs", "fitness", f"in {target}", "loss", "quartiles of the loss"]]
        for one in transfer.designs:
            if one.target == target:
                low, high = np.quantile(one.losses, [0.25, 0.75])
                medians = (
                    float(np.median(values))
                    for values in (one.source_fitness, one.target_fitness, one.losses)
                )
                row = [one.label, str(len(one.losses)), *map(number, medians)]
                rows.append([*row, f"{number(low)} to {number(high)}"])
        yield "Medians of the runs' best:"
        yield from columns(rows)
        rows = [["design", "against", "A12 of the loss", "effect", "difference", "p (Holm)"]]
        pairs = [pair for pair in transfer.pairs if pair.first.target == target]
        for pair in sorted(pairs, key=lambda one: one.difference.p)[:_PAIRS]:
            found = pair.difference
            row = [pair.first.label, pair.second.label, f"{found.effect:.2f}"]
            row.append(found.magnitude or "too few runs")
            rows.append([*row, number(found.shift), p_value(pair.p_holm)])
        yield ""
        yield from columns(rows)
        if len(pairs) > _PAIRS:
            yield f"and {len(pairs) - _PAIRS} pairs with larger p; --json has all"


def _interval(estimate: "Estimate") -> str:
    if estimate.low is None or estimate.high is None:
        return ""
    return f"{number(estimate.low)} to {number(estimate.high)}"


def _correlation(found: "Correlation") -> str:
    if found.low is None or found.high is None:
        return f"{found.rho:.2f}"
    return f"{found.rho:.2f} ({found.low:.2f} to {found.high:.2f})"


def to_mapping(transfer: "Transfer") -> dict[str, Any]:
    """Return a transfer as plain values; NaN is left as it is."""
    return {
        "seeds": list(transfer.seeds),
        "targets": list(transfer.targets),
        "runs": [
            {
                "run": str(one.run.path),
                "target": one.target,
                "failed": one.failed,
                "rank_correlation": None if one.correlation is None else vars(one.correlation),
                "candidates": [
                    {
                        "generation": candidate.generation,
                        "candidate": candidate.candidate,
                        "recorded": candidate.recorded,
                        "fitness": vars(here),
                        "fitness_in_target": vars(there),
                        "loss": vars(lost),
                    }
                    for candidate, here, there, lost in zip(
                        one.candidates, one.source_fitness, one.target_fitness, one.losses, strict=True
                    )
                ],
            }
            for one in transfer.runs
        ],
        "designs": [
            {
                "label": one.label,
                "target": one.target,
                "fitness": one.source_fitness.tolist(),
                "fitness_in_target": one.target_fitness.tolist(),
                "loss": one.losses.tolist(),
            }
            for one in transfer.designs
        ],
        "pairs": [
            {
                "first": pair.first.label,
                "second": pair.second.label,
                "target": pair.first.target,
                "u": pair.difference.u,
                "p": pair.difference.p,
                "p_holm": pair.p_holm,
                "a12": pair.difference.effect,
                "magnitude": pair.difference.magnitude or None,
                "difference": pair.difference.shift,
            }
            for pair in transfer.pairs
        ],
        "notes": list(transfer.notes),
    }
