"""The digests of short runs of all methods, as a program: what must not depend on the processor.

python -m tests.system.records
"""

import hashlib
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
    "cuckoo_search",
    "de",
    "evostick",
    "ga_species",
    "map_elites",
    "nnga",
    "novelty",
    "nsga2",
    "openai_es",
    "pgpe",
    "pso",
    "racing",
    "random_search",
    "sep_cma_es",
    "snes",
    "xnes",
]

NEEDED: dict[str, dict[str, object]] = {
    "map_elites": {"measures": {"distance": {"range": [0, 20], "bins": 10}}},
    "novelty": {"measures": {"distance": {"range": [0, 20], "bins": 10}}},
    "nsga2": {"objectives": {"distance": "minimize"}},
}
"""Options that methods must have."""


def digests() -> dict[str, str]:
    """Return the digest of a run of each method for each experiment, and that of its genomes.

    The first covers what genomes are made from where the store has that instead of them, the second the
    genomes that are made of it.
    """
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, (simulation, controller) in EXPERIMENTS.items():
            for kind in METHODS:
                run = optimize(
                    Experiment.from_mapping(
                        {
                            "simulation": simulation,
                            "controller": controller,
                            "method": {"kind": kind, "generations": 12, **NEEDED.get(kind, {})},
                            "ranking": {"episodes": 2},
                        }
                    ),
                    out=Path(folder) / name / kind,
                    servers="in-process",
                )
                genomes = hashlib.sha256(run.record.genomes.tobytes()).hexdigest()
                found[f"{name}: {kind}"] = f"{run.digest} {genomes}"
    return found


if __name__ == "__main__":
    os.environ["SWARMWRIGHT_PLOT"] = "0"
    json.dump(digests(), sys.stdout, indent=1)
