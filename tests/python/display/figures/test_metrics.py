from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, Run, compare, optimize
from swarmwright.runs.metric_curves import SHARES, MetricCurves

VALUES: dict[str, Any] = {
    "simulation": "minisim", "servers": "in-process", "validate": {"episodes": 0},
    "parameters": {"placement": "random", "numAgents": 3, "numDefenders": 2},
    "fitness": "arrived - 0.1 * caught", "ranking": {"episodes": 2},
    "method": {"kind": "random_search", "population": 9, "generations": 4},
}  # fmt: skip


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return optimize(Experiment.from_mapping(VALUES), out=tmp_path_factory.mktemp("metrics") / "run")


def test_metrics_are_gathered_by_the_fitness_of_a_generation(run: Run) -> None:
    curves = MetricCurves(run, ["caught", "arrived"])
    assert curves.names == ("fitness", "caught", "arrived")
    assert curves.values.shape == (3, len(SHARES), 4)
    record = run.record
    for generation in range(4):
        rows = np.flatnonzero(record.generation == generation)
        order = rows[np.argsort(-record.fitness[rows], kind="stable")]
        # Of nine: the best, the best two, five in the middle, the worst two.
        for share, chosen in enumerate((order[:1], order[:2], order[2:7], order[7:])):
            expected = [
                record.fitness[chosen].mean(),
                record.metrics[chosen, :, run.metrics.index("caught")].mean(),
                record.metrics[chosen, :, run.metrics.index("arrived")].mean(),
            ]
            np.testing.assert_allclose(curves.values[:, share, generation], expected)
    assert curves.x_positions("evaluations").tolist() == [9, 18, 27, 36]


def test_metrics_of_a_run_and_of_groups_are_drawn(run: Run, tmp_path: Path) -> None:
    figure = run.plot(tmp_path / "metrics.pdf", metrics="all", x="generations")
    assert [axes.get_ylabel() for axes in figure.axes] == ["fitness", "arrived (agents)", "caught (agents)"]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == list(SHARES)
    curves = MetricCurves(run, ["arrived", "caught"]).values
    for axes, of_metric in zip(figure.axes, curves, strict=True):
        for line, values in zip(axes.get_lines(), of_metric, strict=True):
            np.testing.assert_array_equal(np.asarray(line.get_ydata()), values)
    other = optimize(
        Experiment.from_mapping({**VALUES, "method": {**VALUES["method"], "population": 2}}),
        out=tmp_path / "other",
    )
    figure = compare([run, other]).figure(metrics=["caught"], style="ieee")
    assert figure.axes[1].get_ylabel() == "caught (agents)"
    lines = {str(line.get_label()): np.asarray(line.get_ydata()) for line in figure.axes[1].get_lines()}
    assert lines["population 9 (1 run)"][-1] == curves[2, SHARES.index("best quarter"), -1]
    # Of two candidates there is no quarter: the best one stands for it.
    best = MetricCurves(other, ["caught"]).values[1, SHARES.index("best")]
    assert lines["population 2 (1 run)"][-1] == best[-1]
    for wrong, words in (
        (["catched"], r"run: metrics: unknown metric 'catched'; available: arrived, caught"),
        ("caught", r"^metrics: must be"),
    ):
        with pytest.raises(InputError, match=words):
            run.plot(metrics=wrong)
    plain = optimize(Experiment.from_mapping({**VALUES, "fitness": None}), out=tmp_path / "plain")
    with pytest.raises(InputError, match=r"plain: has no metric in common with all runs; runs record"):
        plain.plot(metrics="all")
    with pytest.raises(InputError, match=r"^metrics: groups solve several tasks"):
        compare([run, plain]).figure(metrics="all")
