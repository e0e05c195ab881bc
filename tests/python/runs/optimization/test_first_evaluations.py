"""A run whose first evaluations all fail in the same way ends with the reason."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, Run, RunError, SimulationError, optimize
from swarmwright.runs.optimization.failures import FirstEvaluations, FirstFailedError
from swarmwright.servers.evaluation.base import FIRST_EVALUATIONS, Results
from swarmwright.servers.rows import AttemptEntry, Journal, WarningEntry

BROKEN = """\
import numpy as np
from swarmwright import Simulation

class Broken(Simulation):
    title, dimensions, sensors, actuators = "broken", 1, 1, 1
    works_from = {works_from}
    count = 0

    def reset(self, parameters, seed):
        Broken.count += 1
        self.number, self.over = Broken.count, False
        return np.array([[1.0]])

    def step(self, actions):
        if self.number <= self.works_from:
            raise ValueError("no licence")
        self.over = True
        return np.array([[1.0]])

    def done(self):
        return self.over

    def fitness(self):
        return float(self.number)
"""


def failures(count: int, reason: str = "no licence for {}") -> Results:
    """Return results of candidates that all fail, for reasons that differ in numbers alone."""
    attempts = [
        AttemptEntry("offloaded", index, 1, 0, 1, 1, 3, None, 0.0, 1.0, "failed", reason.format(index), None)
        for index in range(count)
    ]
    return Results(np.full((count, 1), np.nan), np.empty((count, 1, 0)), Journal(attempts, []))


def of(results: Results, *rows: int) -> Results:
    """Return the results of some candidates."""
    attempts = [one for one in results.journal.attempts if one.candidate in rows]
    warnings = [one for one in results.journal.warnings if one.candidate in rows]
    return Results(results.fitness[list(rows)], results.metrics[list(rows)], Journal(attempts, warnings))


def test_the_first_ones_fail_in_the_same_way() -> None:
    with pytest.raises(
        FirstFailedError, match=f"the first {FIRST_EVALUATIONS} evaluations all failed for the same reason"
    ):
        FirstEvaluations(None).start_generation()(range(FIRST_EVALUATIONS), failures(FIRST_EVALUATIONS))
    few = FirstEvaluations(None)
    few.start_generation()(range(FIRST_EVALUATIONS - 1), failures(FIRST_EVALUATIONS - 1))
    assert few.is_open
    with pytest.raises(FirstFailedError):  # small generations add up
        few.start_generation()(range(1), failures(1))


def test_the_order_is_that_of_the_candidates() -> None:
    """Whichever server is faster: a later candidate that succeeds changes nothing, an earlier one does."""
    results = failures(12)
    results.fitness[11] = 1.0
    results.fitness[0] = 2.0
    watch = FirstEvaluations(None)
    take = watch.start_generation()
    is_open = []
    for some in ([11], range(1, 11), [0]):
        take(some, of(results, *some))
        is_open.append(watch.is_open)
    assert is_open == [True, True, False]
    results.fitness[0] = np.nan
    take = FirstEvaluations(None).start_generation()
    take([11, *range(1, 10)], of(results, 11, *range(1, 10)))
    with pytest.raises(FirstFailedError):
        take([0], of(results, 0))


def test_different_reasons_and_partial_failures_do_not_end_a_run() -> None:
    different = FirstEvaluations(None)
    results = failures(FIRST_EVALUATIONS)
    results.journal.attempts[3] = results.journal.attempts[3]._replace(error="the wheel came off")
    different.start_generation()(range(FIRST_EVALUATIONS), results)
    assert not different.is_open
    partly = FirstEvaluations(None)
    results = failures(FIRST_EVALUATIONS)
    episodes = np.column_stack([results.fitness[:, 0], np.ones(FIRST_EVALUATIONS)])
    partly.start_generation()(range(FIRST_EVALUATIONS), Results(episodes, results.metrics, results.journal))
    assert not partly.is_open


def test_an_expression_without_a_value_is_a_result_where_failures_have_a_fitness() -> None:
    warnings = [
        WarningEntry.from_episode(0, ": fitness: no value", index, "fitness: no value")
        for index in range(FIRST_EVALUATIONS)
    ]
    results = Results(
        np.full((FIRST_EVALUATIONS, 1), np.nan), np.empty((FIRST_EVALUATIONS, 1, 0)), Journal([], warnings)
    )
    FirstEvaluations(0.0).start_generation()(range(FIRST_EVALUATIONS), results)
    with pytest.raises(FirstFailedError):
        FirstEvaluations(None).start_generation()(range(FIRST_EVALUATIONS), results)


def broken(folder: Path, works_from: int = 10**9, **values: Any) -> Experiment:
    (folder / "broken.py").write_text(BROKEN.format(works_from=works_from))
    file = folder / "broken.yaml"
    file.write_text("simulation: broken.py:Broken\n")
    changes = {"method": {"kind": "nnga", "population": 30, "generations": 2}, "faults": {"attempts": 2}}
    return Experiment.load(file).replace(**{**changes, **values})


@pytest.mark.slow
@pytest.mark.parametrize("servers", ["in-process", 2])
@pytest.mark.parametrize("failed", ["last", -3.0])
def test_a_broken_simulation_ends_a_run(tmp_path: Path, servers: int | str, failed: str | float) -> None:
    experiment = broken(tmp_path, ranking={"kind": "absolute", "failed": failed})
    message = rf"^the first {FIRST_EVALUATIONS} evaluations all failed for the same reason.*no licence"
    with pytest.raises(SimulationError, match=message):
        optimize(experiment, servers=servers, out=tmp_path / "run")
    run = Run.open(tmp_path / "run")
    assert run.state == "failed"
    tried = {(one.candidate, one.attempt) for one in run.attempts()}
    assert tried == {(candidate, attempt) for candidate in range(FIRST_EVALUATIONS) for attempt in (1, 2)}


def test_a_broken_simulation_ends_a_run_in_steady_state(tmp_path: Path) -> None:
    method = {"kind": "nnga", "population": 30, "generations": 2, "operation": "steady_state"}
    with pytest.raises(
        RunError, match=f"^the first {FIRST_EVALUATIONS} evaluations all failed for the same reason"
    ):
        optimize(broken(tmp_path, method=method), servers="in-process", out=tmp_path / "run")
    assert list(Run.open(tmp_path / "run").attempts())


def test_one_success_among_the_first_is_enough(tmp_path: Path) -> None:
    """Of 10 candidates with two attempts each, the last has another attempt, which succeeds."""
    experiment = broken(tmp_path, works_from=2 * FIRST_EVALUATIONS - 1)
    run = optimize(experiment, servers="in-process", out=tmp_path / "run")
    assert run.state == "done"
    assert run.failed_evaluations == FIRST_EVALUATIONS - 1
