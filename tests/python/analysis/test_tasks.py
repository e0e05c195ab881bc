"""Which groups solve the same task."""

from pathlib import Path
from typing import Any

from swarmwright.analysis.groups import RunGroup, group
from swarmwright.analysis.tasks import TaskGroups, group_by_task
from tests.python.analysis.runs import KnownRun


def tasks(
    path: Path, *changes: dict[str, Any], by: str = "fitness", held_out: bool = False
) -> list[TaskGroups]:
    runs = [KnownRun(path / str(number), [[1.0]], **one) for number, one in enumerate(changes)]
    return group_by_task(group(runs)[0], by=by, held_out=held_out)


GATHERING = {
    "title": "Gathering",
    "walls": {"rectangle": [4, 3]},
    "start": {"disc": {"radius": 0.5}},
    "metrics": {"gathered": {"kind": "covered_share", "radius": 0.25, "when": "end"}},
    "fitness": "gathered",
}
METHODS = [{"method": {"population": size}} for size in (4, 9)]


def with_methods(*changes: dict[str, Any]) -> list[dict[str, Any]]:
    return [{**one, **method} for one in changes for method in METHODS]


def test_methods_alone_solve_one_task(tmp_path: Path) -> None:
    (one,) = tasks(tmp_path, *METHODS)
    assert (one.label, one.differs, one.indices) == ("", {}, (0, 1))


def test_groups_that_differ_in_the_task_alone_are_together(tmp_path: Path) -> None:
    (one,) = tasks(tmp_path, {"parameters": {"maxSteps": 10}}, {"parameters": {"maxSteps": 20}})
    assert (one.label, one.indices) == ("", (0, 1))


def test_groups_of_different_missions_or_definitions_of_fitness_are_never_together(tmp_path: Path) -> None:
    arena = {"simulation": "arena", "controller": {"kind": "evostick"}}
    missions = [{**arena, "parameters": {"mission": name}} for name in ("aggregation", "foraging")]
    assert [one.label for one in tasks(tmp_path, *missions)] == ["mission aggregation", "mission foraging"]
    parts = [
        {**arena, "parameters": {"mission": {**GATHERING, **part}}}
        for part in ({}, {"fitness": "largest_group"}, {"duration": 9})
    ]
    assert len(tasks(tmp_path, parts[0], parts[1])) == 2
    assert len(tasks(tmp_path, parts[0], parts[2])) == 1
    worst = {"ranking": {"episodes": 3, "aggregate": "worst"}}
    assert len(tasks(tmp_path, {"ranking": {"episodes": 3}}, worst)) == 2


def test_groups_that_are_alone_in_their_tasks_are_together_where_nothing_else_differs(
    tmp_path: Path,
) -> None:
    steps = [{"parameters": {"maxSteps": number, "seed": number}} for number in (10, 20)]
    assert len(tasks(tmp_path, *steps)) == 1
    found = tasks(tmp_path, steps[0], {**steps[1], "method": {"population": 9}})
    assert [one.indices for one in found] == [(0,), (1,)]


def test_reference_models_of_the_e_puck_make_no_task(tmp_path: Path) -> None:
    """Methods of the field have a reference model each, and are compared on one robot."""

    def design(kind: str, **parameters: Any) -> dict[str, Any]:
        return {"simulation": "arena", "controller": {"kind": kind}, "parameters": parameters}

    aggregation, foraging = (
        [
            design("evostick", mission=mission),
            design("modules", mission=mission, robot="e-puck-rm1.2"),
            design("evostick", mission=mission, robot={"preset": "e-puck-rm1.1"}),
        ]
        for mission in ("aggregation", "foraging")
    )
    assert len(tasks(tmp_path, *aggregation[:2])) == 1
    found = tasks(tmp_path, *aggregation[:2], *foraging[:2])
    assert [(one.label, one.indices) for one in found] == [
        ("mission aggregation", (0, 1)),
        ("mission foraging", (2, 3)),
    ]
    assert len(tasks(tmp_path, *aggregation)) == 1
    noisy = design("evostick", mission="aggregation", robot={"preset": "e-puck-rm1.1", "drive": {"noise": 0}})
    assert [one.indices for one in tasks(tmp_path, *aggregation[:2], noisy)] == [(0, 1), (2,)]
    kilobots = design("layered", mission="aggregation", robot="kilobot")
    assert [one.indices for one in tasks(tmp_path, *aggregation[:2], kilobots)] == [(0, 1), (2,)]


def test_the_seed_of_a_simulation_makes_no_task(tmp_path: Path) -> None:
    (one,) = tasks(tmp_path, *with_methods({"parameters": {"seed": 1}}, {"parameters": {"seed": 2}}))
    assert one.indices == (0, 1, 2, 3)


def test_definitions_of_fitness_make_tasks_where_they_count(tmp_path: Path) -> None:
    runs = (KnownRun(tmp_path / "run", [[1.0]]),)
    expressions = [
        RunGroup("", {"fitness": expression, "method.population": size}, runs)
        for expression in (None, "2 * steps")
        for size in (4, 9)
    ]
    found = group_by_task(expressions, by="fitness", held_out=False)
    assert [one.label for one in found] == ["fitness not given", "fitness 2 * steps"]
    assert len(group_by_task(expressions, by="fitness", held_out=True)) == 2
    assert len(group_by_task(expressions, by="coverage", held_out=False)) == 1
    aggregates = with_methods(
        {"ranking": {"episodes": 3}}, {"ranking": {"episodes": 3, "aggregate": "worst"}}
    )
    assert [one.differs for one in tasks(tmp_path, *aggregates)] == [
        {"ranking.aggregate": "mean"},
        {"ranking.aggregate": "worst"},
    ]
    assert len(tasks(tmp_path, *aggregates, held_out=True)) == 1


def test_simulations_are_tasks_with_their_names(tmp_path: Path) -> None:
    foreign = {"simulation": "theirs", "sensors": 2, "actuators": 1, "servers": "auto"}
    found = tasks(tmp_path, *with_methods({}, foreign))
    assert [one.indices for one in found] == [(0, 1), (2, 3)]
    assert ["minisim" in one.label for one in found] == [True, False]
    assert "theirs" in found[1].label
