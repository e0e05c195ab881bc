"""Types of results of the library, for annotations.

    from swarmwright.results import Best

    def report(best: Best) -> str:
        return f"{best.fitness} of generation {best.generation}"

These names are stable, while the modules that define them may change. They are not constructed by users.
`ComparedGroup` is a group of runs in a comparison, `RunGroup` one in a transfer; `swarmwright.Group` is one
of agents. `Candidate` is one in a transfer, `Axis`, `Cells` and `Grid` are of an archive, and `Subject` is
exported.
"""

from swarmwright.analysis.comparison import Group as ComparedGroup
from swarmwright.analysis.comparison import Pair, Task
from swarmwright.analysis.episodes import LeftOut
from swarmwright.analysis.groups import RunGroup
from swarmwright.analysis.indicators import Indicator
from swarmwright.analysis.significance import Difference, Kruskal, SignedRank
from swarmwright.analysis.sweep.result import Failure
from swarmwright.analysis.transfer.result import GroupLoss, GroupPair, GroupTask
from swarmwright.common.ranges import Range
from swarmwright.common.statistics import Correlation, Estimate, Summary
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import Channel, Subject
from swarmwright.export.verification import Verification
from swarmwright.methods.archive import Axis, Cells, Grid
from swarmwright.methods.constraints import Limits
from swarmwright.methods.voronoi import Voronoi
from swarmwright.runs.elites import Elite, Elites, Outside
from swarmwright.runs.learning_curve import CurvePoint
from swarmwright.runs.page import ReplayPage
from swarmwright.runs.reproduction import Interval
from swarmwright.runs.run import Best
from swarmwright.runs.store import Evaluation
from swarmwright.runs.store.table import RecordTable
from swarmwright.runs.transfer.transferred import Candidate, Transferred
from swarmwright.servers.evaluation.episodes import Observation
from swarmwright.servers.rows import Attempt, Event, Session

__all__ = [
    "Attempt",
    "Axis",
    "Best",
    "Candidate",
    "Cells",
    "Channel",
    "ComparedGroup",
    "Correlation",
    "CurvePoint",
    "Difference",
    "Elite",
    "Elites",
    "Estimate",
    "Evaluation",
    "Event",
    "Failure",
    "Grid",
    "GroupLoss",
    "GroupPair",
    "GroupTask",
    "Indicator",
    "Interval",
    "Kruskal",
    "LeftOut",
    "Limits",
    "Observation",
    "Outside",
    "Pair",
    "Range",
    "RecordTable",
    "ReplayPage",
    "RunGroup",
    "Sequences",
    "Session",
    "SignedRank",
    "Subject",
    "Summary",
    "Task",
    "Transferred",
    "Verification",
    "Voronoi",
]
