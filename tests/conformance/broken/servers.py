"""Simulation servers that break one rule each, and are else as they should be.

`breaks` names the rules that must catch it, and no other may; what cannot be tried because of that does not
count.
"""

from tests.conformance.broken import discovery, episodes, messages, samples, seeds  # noqa: F401 - their servers
from tests.conformance.broken.base import Broken
from tests.conformance.broken.batches import BrokenBatched
from tests.conformance.broken.offloaded import BrokenRobots
from tests.conformance.broken.steered import BrokenSteered

SERVERS: list[type[Broken]] = [
    *(kind for kind in Broken.__subclasses__() if kind not in {BrokenBatched, BrokenSteered}),
    *BrokenBatched.__subclasses__(),
    *BrokenRobots.__subclasses__(),
    *BrokenSteered.__subclasses__(),
]
