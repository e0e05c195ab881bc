"""Types of results, for annotations: what functions and attributes of the library return.

    from swarmwright.results import Best

    def report(best: Best) -> str:
        return f"{best.fitness} of generation {best.generation}"

These names stay where they are; the modules that define them may change. They are returned, not constructed.
`ComparedGroup` is a group of runs in a comparison, unlike `swarmwright.Group`, agents of one kind.
"""

from swarmwright.analysis.comparison import Group as ComparedGroup
from swarmwright.analysis.comparison import Pair, Task
from swarmwright.analysis.indicators import Indicator
from swarmwright.analysis.significance import Difference, Kruskal
from swarmwright.analysis.sweep.result import Failure
from swarmwright.core.statistics import Estimate, Summary
from swarmwright.evaluation.episodes import Observation
from swarmwright.runs.elites import Elite, Elites
from swarmwright.runs.page import ReplayPage
from swarmwright.runs.run import Best
from swarmwright.runs.transfer.transferred import Transferred
from swarmwright.store import Evaluation
from swarmwright.store.rows import Attempt, Event, Session
from swarmwright.store.table import RecordTable

__all__ = [
    "Attempt",
    "Best",
    "ComparedGroup",
    "Difference",
    "Elite",
    "Elites",
    "Estimate",
    "Evaluation",
    "Event",
    "Failure",
    "Indicator",
    "Kruskal",
    "Observation",
    "Pair",
    "RecordTable",
    "ReplayPage",
    "Session",
    "Summary",
    "Task",
    "Transferred",
]
