"""Rankings: the order of candidates, from the fitness of their episodes. `RANKINGS` has all kinds by name."""

from swarmwright.core.registry import Registry
from swarmwright.rankings._base import Ranking, RankingOptions

__all__ = ["RANKINGS", "Ranking", "RankingOptions"]

RANKINGS: Registry[Ranking] = Registry(
    "ranking",
    "swarmwright.rankings",
    {
        "absolute": "swarmwright.rankings.absolute:Absolute",
        "multi_fidelity": "swarmwright.rankings.multi_fidelity:MultiFidelity",
        "race": "swarmwright.rankings.race:Race",
        "transferability": "swarmwright.rankings.transferability:Transferability",
    },
    "swarmwright.rankings:Ranking",
)
"""All rankings, by the `kind` of an experiment's `ranking`."""
