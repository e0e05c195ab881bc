"""The record of a sweep in the folder of its runs, `sweep.json`: what was asked for, and which runs that is.

Keys: `file` (the sweep file, null without one), `settings` (of `--set`), `seeds`, `experiment` (the keys of
the experiment that all variants have in common), `variants` (`label`, `keys`: those that the grid sets,
`experiment`: the keys that differ, `runs`: a folder for each seed). Keys that say where runs are computed are
left out.
"""

import json
import os
from collections.abc import Sequence
from typing import Any

from swarmwright.analysis.sweep.file import Sweep
from swarmwright.analysis.sweep.recorded import with_names
from swarmwright.analysis.sweep.run import Task
from swarmwright.analysis.sweep.variants import Variant
from swarmwright.common.errors import InputError
from swarmwright.common.files import write_whole
from swarmwright.experiment.experiment import ELSEWHERE
from swarmwright.runs.store.folder import SWEEP

_LEFT_OUT = (ELSEWHERE - {"validate"}) | {"seed"}


def write(sweep: Sweep, tasks: Sequence[Task]) -> None:
    """Write the record, instead of that of an earlier sweep; nothing where it is there already.

    Raises InputError where it cannot be written.
    """
    file = sweep.out / SWEEP
    data = f"{json.dumps(_plain(sweep, tasks), default=str, ensure_ascii=False, indent=1)}\n".encode()
    try:
        if file.is_file() and file.read_bytes() == data:
            return
        sweep.out.mkdir(parents=True, exist_ok=True)
        write_whole(file, data)
    except OSError as error:
        raise InputError(f"{file}: cannot be written: {os.strerror(error.errno or 0)}") from error


def _plain(sweep: Sweep, tasks: Sequence[Task]) -> dict[str, Any]:
    experiments = [_recorded_variant(one) for one in sweep.variants]
    first = experiments[0]
    common = {
        key: value
        for key, value in first.items()
        if all(key in one and one[key] == value for one in experiments)
    }
    runs: dict[int, list[str]] = {}
    for task in tasks:
        runs.setdefault(id(task.variant), []).append(task.folder.name)
    return {
        "file": None if sweep.file is None else str(sweep.file),
        "settings": list(sweep.settings),
        "seeds": list(sweep.seeds),
        "experiment": common,
        "variants": [
            {
                "label": variant.label,
                "keys": list(variant.keys),
                "experiment": {key: value for key, value in one.items() if key not in common},
                "runs": runs.get(id(variant), []),
            }
            for variant, one in zip(sweep.variants, experiments, strict=True)
        ],
    }


def _recorded_variant(variant: Variant) -> dict[str, Any]:
    """Return what the record has of a variant: a sweep that is repeated by it keeps the names of code."""
    experiment = variant.experiment
    kept = {key: value for key, value in experiment.to_mapping().items() if key not in _LEFT_OUT}
    return with_names(kept, variant.names)
