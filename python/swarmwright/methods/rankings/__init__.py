"""Rankings, which turn the fitness of episodes into the fitness of candidates.

`RANKINGS.names()` lists the kinds of an experiment's `ranking`, including plug-ins;
`RANKINGS.get("race")` is the class of one. An experiment makes its ranking by `Experiment.new_ranking()`. A
custom ranking is a class derived from `Ranking`: docs/how-to/plug-ins.md.
"""

from swarmwright.common.registry import Registry
from swarmwright.methods.rankings._base import Ranking, RankingOptions

__all__ = ["RANKINGS", "Ranking", "RankingOptions"]

RANKINGS: Registry[Ranking] = Registry(
    "ranking",
    "swarmwright.rankings",
    {
        "absolute": "swarmwright.methods.rankings.absolute:Absolute",
        "multi_fidelity": "swarmwright.methods.rankings.multi_fidelity:MultiFidelity",
        "race": "swarmwright.methods.rankings.race:Race",
        "tournament": "swarmwright.methods.rankings.tournament:Tournament",
        "transferability": "swarmwright.methods.rankings.transferability:Transferability",
    },
    "swarmwright.methods.rankings:Ranking",
    in_files=True,
)
"""All rankings, by the `kind` of an experiment's `ranking`."""
