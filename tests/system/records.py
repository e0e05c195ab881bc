"""The digests of short runs of all methods, as a program: what must not depend on the processor.

python -m tests.system.records
"""

import json
import os
import sys
import tempfile
from pathlib import Path

from swarmwright import Experiment, optimize

EXPERIMENTS = {
    "minisim": ("minisim", {"kind": "layered", "hidden": [8]}),
    "minisim, sigmoid": ("minisim", {"kind": "layered", "hidden": [5, 3], "activation": "sigmoid"}),
    "minisim, evostick": ("minisim", {"kind": "evostick"}),
    "emergency_exit": ("emergency_exit", {"kind": "fully_meshed", "hidden": 2}),
}
METHODS = [
    "cea2d",
    "cma_es",
    "de",
    "evostick",
    "nnga",
    "openai_es",
    "pgpe",
    "pso",
    "racing",
    "random_search",
    "sep_cma_es",
    "snes",
    "xnes",
]


def digests() -> dict[str, str]:
    """Return the digest of a run of each method for each experiment."""
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, (simulation, controller) in EXPERIMENTS.items():
            for kind in METHODS:
                run = optimize(
                    Experiment.from_mapping(
                        {
                            "simulation": simulation,
                            "controller": controller,
                            "method": {"kind": kind, "generations": 12},
                            "ranking": {"episodes": 2},
                        }
                    ),
                    out=Path(folder) / name / kind,
                    servers="in-process",
                )
                found[f"{name}: {kind}"] = run.digest
    return found


if __name__ == "__main__":
    os.environ["SWARMWRIGHT_PLOT"] = "0"
    json.dump(digests(), sys.stdout, indent=1)
