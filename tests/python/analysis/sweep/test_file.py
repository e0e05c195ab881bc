import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, InputError
from swarmwright.analysis.sweep import Sweep, list_tasks
from swarmwright.analysis.sweep.file import _seeds
from swarmwright.common.yaml import Source
from swarmwright.experiment.budget import Budget

BASE = """\
simulation: minisim
method: {kind: nnga, population: 6, generations: 3, severity: 0.2}
servers: local
seed: 9
"""


def sweep(folder: Path, text: str) -> Sweep:
    (folder / "base.yaml").write_text(BASE)
    (folder / "methods.yaml").write_text(text)
    return Sweep.load(folder / "methods.yaml")


def test_every_combination_is_a_variant(tmp_path: Path) -> None:
    found = sweep(
        tmp_path,
        "experiment: base.yaml\ngrid: {method.population: [6, 8], parameters.maxSteps: [5, 9]}\nseeds: 2\n",
    )
    assert [one.label for one in found.variants] == [
        "population 6, maxSteps 5", "population 6, maxSteps 9", "population 8, maxSteps 5",
        "population 8, maxSteps 9",
    ]  # fmt: skip
    third = found.variants[2].experiment
    assert (vars(third.method)["population"], third.parameters["maxSteps"]) == (8, 5)
    assert found.seeds == (1, 2)
    assert found.out == Path("runs/methods")
    todo = list_tasks(found)
    assert [task.seed for task in todo] == [1] * 4 + [2] * 4
    assert [task.experiment.seed for task in todo] == [1] * 4 + [2] * 4
    assert len({task.folder for task in todo}) == 8
    assert todo[0].folder == Path("runs/methods/population_6_maxSteps_5-1")


def test_a_variant_is_the_experiment_with_its_values_set(tmp_path: Path) -> None:
    base = BASE.replace("generations: 3", "generations: 3, target: 9.0, population: 50").replace(
        "population: 6, ", ""
    )
    base += "ranking: {kind: absolute, episodes: 12, seeds: new}\n"
    base += "controller: {kind: layered, activation: tanh}\n"
    (tmp_path / "base.yaml").write_text(base)
    given = {
        "method.kind": ["cma_es", "nnga"],
        "controller.kind": ["fully_meshed"],
        "ranking.kind": ["race"],
    }
    (tmp_path / "kinds.yaml").write_text(f"experiment: base.yaml\ngrid: {json.dumps(given)}\n")
    found = Sweep.load(tmp_path / "kinds.yaml")
    for variant, method in zip(found.variants, given["method.kind"], strict=True):
        settings = [f"method.kind={method}", "controller.kind=fully_meshed", "ranking.kind=race"]
        alone = Experiment.load(tmp_path / "base.yaml", settings)
        assert variant.experiment.to_mapping() == alone.to_mapping(), method


def test_robots_with_other_sensors(tmp_path: Path) -> None:
    (tmp_path / "arena.yaml").write_text("simulation: arena\n")
    file = tmp_path / "robots.yaml"
    file.write_text(
        "experiment: arena.yaml\ngrid: {parameters.robot: [e-puck-rm1.1, e-puck-rm1.2]}\nout: robots\n"
    )
    assert [one.experiment.sensors for one in Sweep.load(file).variants] == [24, 9]


def test_another_kind_keeps_no_options_of_the_same_name(tmp_path: Path) -> None:
    found = sweep(
        tmp_path,
        "experiment: base.yaml\nseeds: [3, 1]\n"
        "grid: {method.population: [7], method.kind: [random_search, nnga]}\n",
    )
    other, same = (one.experiment.method for one in found.variants)
    assert (other.kind, vars(other)["population"], other.generations) == ("random_search", 7, 3)
    assert (same.kind, vars(same)["severity"]) == ("nnga", 0.2)
    assert found.seeds == (3, 1)


def test_another_kind_has_its_own_defaults(tmp_path: Path) -> None:
    # Both have `elite`, `mutate` and `crossover`, with other defaults, and each set of shares adds up to 1.
    found = sweep(tmp_path, "experiment: base.yaml\ngrid: {method.kind: [cea2d], method.renew: [0.0]}\n")
    method: Any = found.variants[0].experiment.method
    assert (method.kind, method.generations, method.severity) == ("cea2d", 3, 0.3)
    assert (method.elite, method.mutate, method.crossover) == (0.11, 0.59, 0.3)


def test_a_race_keeps_no_number_of_generations(tmp_path: Path) -> None:
    found = sweep(tmp_path, "experiment: base.yaml\ngrid: {method.kind: [racing], method.seconds: [9.0]}\n")
    assert found.variants[0].experiment.budget == Budget(None, 10_000, 9.0)


def test_a_limit_means_the_same_for_every_kind(tmp_path: Path) -> None:
    found = sweep(
        tmp_path,
        "experiment: base.yaml\ngrid: {method.kind: [nnga, cma_es, racing], method.evaluations: [2000]}\n",
    )
    assert [one.experiment.budget for one in found.variants] == [Budget(None, 2000, None)] * 3


def test_without_a_grid_the_experiment_is_the_only_variant(tmp_path: Path) -> None:
    found = sweep(tmp_path, "experiment: base.yaml\nseeds: 3\n")
    (variant,) = found.variants
    assert (variant.label, variant.folder) == ("minisim, nnga", "minisim_nnga")
    assert variant.experiment.generations == 3
    assert [task.folder.name for task in list_tasks(found)] == [
        "minisim_nnga-1",
        "minisim_nnga-2",
        "minisim_nnga-3",
    ]


def test_the_seed_of_the_simulation_is_no_seed_of_runs(tmp_path: Path) -> None:
    found = sweep(tmp_path, "experiment: base.yaml\ngrid: {parameters.seed: [1, 2]}\nseeds: [3]\n")
    assert [one.label for one in found.variants] == ["parameters.seed 1", "parameters.seed 2"]


def test_options_of_the_same_name_but_of_another_sort_are_not_kept(tmp_path: Path) -> None:
    found = sweep(
        tmp_path,
        "experiment: base.yaml\n"
        "grid: {controller.kind: [fully_meshed], controller.activation: [tanh, sigmoid]}\n",
    )
    one, other = (vars(variant.experiment.controller) for variant in found.variants)
    assert (one["kind"], one["hidden"], one["activation"]) == ("fully_meshed", 2, "tanh")
    assert other["activation"] == "sigmoid"


def test_several_grids_may_overlap(tmp_path: Path) -> None:
    found = sweep(
        tmp_path,
        "experiment: base.yaml\nout: there\ngrid:\n- method.severity: [0.1, 0.2]\n"
        "- {method.kind: [random_search]}\n- method.generations: [3, 4]\n",
    )
    assert [one.label for one in found.variants] == [
        "severity 0.1",
        "severity 0.2",
        "random_search",
        "generations 4",
    ]
    assert found.out == Path("there")
    assert found.seeds == (1, 2, 3, 4, 5)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is not a sweep file"),
        ("- 1", "is not a sweep file"),
        ("a: [", "methods.yaml:"),
        ("grid: {method.severity: [0.1]}", "experiment: must be the path of an experiment file"),
        (
            "experiment: base.yml\ngrid: {method.severity: [0.1]}",
            "base.yml: does not exist; did you mean 'base.yaml'?",
        ),
        ("experiment: nothing.yaml\ngrid: {method.severity: [0.1]}", "nothing.yaml: does not exist"),
        ("experiment: base.yaml\ngrid:", "grid: must be a mapping"),
        ("experiment: base.yaml\ngrid: []", "grid: must be a mapping"),
        ("experiment: base.yaml\ngrid: {}", "grid: must be a mapping"),
        (
            "experiment: base.yaml\ngrid: {method.severity: 3}",
            "methods.yaml:2: grid.method.severity: must be a list",
        ),
        ("experiment: base.yaml\ngrid: {method.severity: []}", "must be a list"),
        ("experiment: base.yaml\ngrid: {seed: [1]}", "use the key 'seeds'"),
        ("experiment: base.yaml\nseeds: [1, 2, 1]", "methods.yaml:2: seeds: the seed 1 occurs twice"),
        ("experiment: base.yaml\ngrid: {method.severit: [1]}", "with severit 1: method.severit: unknown key"),
        ("experiment: base.yaml\ngrid: {method.kind: [magic]}", "magic"),
        (
            "experiment: base.yaml\ngrid: {method.kind: [random_search], method.severity: [0.1]}",
            "method.severity",
        ),
        ("experiment: base.yaml\ngrid: {method.severity: [0.1]}\nseeds: 0", "methods.yaml:3: seeds: must be"),
        (
            "experiment: base.yaml\ngrid: {method.severity: [0.1]}\nseeds: [1, -1]",
            "or a list of seeds (integers from 0)",
        ),
        ("experiment: base.yaml\ngrid: {method.severity: [0.1]}\nseeds: []", "seeds: must be"),
        (
            "experiment: base.yaml\ngrid: {method.severity: [0.1]}\nseed: 3",
            "unknown key; did you mean 'seeds'?",
        ),
        (
            "experiment: base.yaml\nset: {method.severity: 0.1}",
            "methods.yaml:2: set: unknown key; known keys: experiment, grid, seeds, out",
        ),
        (
            "experiment: base.yaml\ngrid: {method.severity: [0.1]}\nout: 3",
            "out: must be the path of a folder",
        ),
        ("experiment: base.yaml\ngrid: {method.severity: [0.1, 0.3]}\nseeds: 99999", "too many runs"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError) as error:
        sweep(tmp_path, text)
    assert said in str(error.value)


@pytest.mark.parametrize(
    ("there", "words"),
    [
        ("a run", "is a run folder; choose another folder"),
        ("a file", "is a file; choose a folder for the runs"),
    ],
)
def test_runs_go_neither_into_a_run_nor_into_a_file(there: str, words: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    if there == "a file":
        out.touch()
    else:
        out.mkdir()
        (out / "run.sqlite").touch()
    with pytest.raises(InputError, match=f"methods.yaml:2: out: {out}: {words}"):
        sweep(tmp_path, f"experiment: base.yaml\nout: {out}\n")
    with pytest.raises(InputError, match=f"^{out}: {words}"):
        Sweep.load(tmp_path / "methods.yaml", out=out)


def test_parts_of_options_are_set_as_on_the_command_line(tmp_path: Path) -> None:
    method = {"kind": "map_elites", "generations": 3, "measures": {
        "steps": {"range": [0, 12], "bins": 6}, "distance": {"range": [0, 30], "bins": 5},
    }}  # fmt: skip
    (tmp_path / "base.yaml").write_text(f"simulation: minisim\nmethod: {json.dumps(method)}\n")
    grid = {
        "method.measures.steps.bins": [3, 9],
        "method.measures.distance.range[1]": [40],
        "method.population": [7],
    }
    (tmp_path / "parts.yaml").write_text(f"experiment: base.yaml\ngrid: {json.dumps(grid)}\n")
    found = Sweep.load(tmp_path / "parts.yaml").variants
    assert len(found) == 2
    for variant, bins in zip(found, (3, 9), strict=True):
        settings = [
            f"method.measures.steps.bins={bins}", "method.measures.distance.range[1]=40",
            "method.population=7",
        ]  # fmt: skip
        assert variant.experiment == Experiment.load(tmp_path / "base.yaml", settings)
        assert f"bins {bins}" in variant.label


@pytest.mark.parametrize(
    ("grid", "setting", "key"),
    [
        ("{method.population: [6, 8]}", "method.population=3", "method.population"),
        ("{simulation: [minisim]}", "simulation=minisim", "simulation"),
        ("[{method.population: [6]}, {method.population: [8]}]", "method.population=3", "method.population"),
        ("[{method.population: [6]}, {method.severity: [0.1]}]", "method.population=3", None),
        ("{method.population: [6, 8]}", "method.severity=0.3", None),
        ("{method.kind: [nnga, pso]}", "method.population=3", None),
        ("{parameters.maxSteps: [5]}", "parameters.numAgents=2", None),
    ],
)
def test_settings_that_no_variant_has_are_refused(
    tmp_path: Path, grid: str, setting: str, key: str | None
) -> None:
    (tmp_path / "base.yaml").write_text(BASE)
    file = tmp_path / "methods.yaml"
    file.write_text(f"experiment: base.yaml\ngrid: {grid}\n")
    if key is None:
        assert Sweep.load(file, settings=[setting]).variants
        return
    with pytest.raises(InputError, match=f"^--set {setting}: every variant has another value, of '{key}'"):
        Sweep.load(file, settings=[setting])


@pytest.mark.parametrize(
    ("grid", "setting", "leaf", "key"),
    [
        (
            "{method.severity: [0.1], method.evaluations: [12, 18]}",
            "method.generations=2",
            "method.generations",
            "method.evaluations",
        ),
        (
            "{method: [{population: 5}, {population: 8}]}",
            "method.population=3",
            "method.population",
            "method",
        ),
        (
            "{controller: [{hidden: [3]}, {hidden: [4]}]}",
            "controller.hidden=[5]",
            "controller.hidden",
            "controller",
        ),
        (
            "{parameters.maxSteps: [5, 6]}",
            "parameters={maxSteps: 9}",
            "parameters.maxSteps",
            "parameters.maxSteps",
        ),
        ("{method.population: [6]}", "method={population: 9}", "method.population", "method.population"),
        ("{method.kind: [cma_es]}", "method.severity=0.3", "method.severity", "method.kind"),
        ("{method: [{population: 5}, {severity: 0.5}]}", "method.population=3", None, None),
        ("{parameters.maxSteps: [5, 9]}", "parameters={maxSteps: 9}", None, None),
        ("{method.evaluations: [12, 18]}", "method.population=4", None, None),
    ],
)
def test_settings_that_other_keys_of_the_grid_replace_are_refused(
    tmp_path: Path, grid: str, setting: str, leaf: str | None, key: str | None
) -> None:
    (tmp_path / "base.yaml").write_text(BASE)
    file = tmp_path / "methods.yaml"
    file.write_text(f"experiment: base.yaml\ngrid: {grid}\n")
    if key is None:
        assert Sweep.load(file, settings=[setting]).variants
        return
    with pytest.raises(InputError) as caught:
        Sweep.load(file, settings=[setting])
    assert str(caught.value).startswith(
        f"--set {setting}: no variant has this value of {leaf}, because of '{key}' in the grid"
    )


def test_a_part_of_an_option_of_another_kind(tmp_path: Path) -> None:
    grid = {"method.kind": ["nsga2"], "method.objectives.steps": ["minimize", "maximize"]}
    found = sweep(tmp_path, f"experiment: base.yaml\ngrid: {json.dumps(grid)}\n")
    objectives = [vars(one.experiment.method)["objectives"] for one in found.variants]
    assert objectives == [{"steps": "minimize"}, {"steps": "maximize"}]


def test_a_part_of_what_has_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"with .*method\.population is 6, which has no key 'x'"):
        sweep(tmp_path, "experiment: base.yaml\ngrid: {method.population.x: [1]}\n")
    with pytest.raises(InputError, match=r"also sets all of 'parameters\.a'"):
        sweep(tmp_path, "experiment: base.yaml\ngrid: {parameters.a: [1], parameters.a.b: [1]}\n")


FORMULAS = ["arrived - 0.1 * distance - 0.01 * steps", "arrived - 0.1 * distance - 0.5 * steps"]


def test_labels_show_where_long_values_differ_and_folders_have_a_digest(tmp_path: Path) -> None:
    found = sweep(tmp_path, f"experiment: base.yaml\ngrid: {{fitness: {json.dumps(FORMULAS)}}}\n")
    assert [one.label for one in found.variants] == [
        "fitness arrived … 0.01 * steps",
        "fitness arrived … 0.5 * steps",
    ]
    assert [one.folder for one in found.variants] == [
        "fitness_arrived_-_0.1_distanc",
        "fitness_arrived_-_0.1_distanc-3b9d64",
    ]


def test_folders_stay_when_values_are_appended(tmp_path: Path) -> None:
    more = [*FORMULAS, FORMULAS[0].replace("0.01", "0.02"), FORMULAS[0].replace("0.01", "0.51")]
    folders: list[list[str]] = []
    for count in range(1, len(more) + 1):
        grid = {"fitness": more[:count], "controller.hidden": [[20] * 8]}
        found = sweep(tmp_path, f"experiment: base.yaml\ngrid: {json.dumps(grid)}\n")
        folders.append([one.folder for one in found.variants])
    for fewer, longer in pairwise(folders):
        assert longer[: len(fewer)] == fewer
    assert len(set(folders[-1])) == len(more)


def test_folders_are_named_as_by_earlier_versions(tmp_path: Path) -> None:
    measures = {"steps": {"range": [0, 12], "bins": 6}}
    grid = {"method.kind": ["map_elites"], "method.measures": [measures]}
    found = sweep(tmp_path, f"experiment: base.yaml\ngrid: {json.dumps(grid)}\n")
    assert found.variants[0].folder == "map_elites_measures_steps_range_0"


def test_labels_of_measures_are_readable(tmp_path: Path) -> None:
    measures = [{"steps": {"range": [0, 12], "bins": bins}} for bins in (6, 9)]
    grid = {"method.kind": ["map_elites"], "method.measures": measures}
    found = sweep(tmp_path, f"experiment: base.yaml\ngrid: {json.dumps(grid)}\n")
    assert [one.label for one in found.variants] == [
        "measures steps.bins 6",
        "measures steps.bins 9",
    ]


def test_many_variants_and_seeds_are_read_in_linear_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compared = 0
    equal = Experiment.__eq__

    def counted(self: Experiment, other: object) -> bool:
        nonlocal compared
        compared += 1
        return equal(self, other)

    monkeypatch.setattr(Experiment, "__eq__", counted)
    speeds = [0.5 + index / 1000 for index in range(100)]
    values = {"grid": {"parameters.speedAgents": speeds}, "seeds": list(range(500))}
    (tmp_path / "base.yaml").write_text(BASE)
    found = Sweep.from_mapping({"experiment": Experiment.load(tmp_path / "base.yaml"), **values})
    assert len(found.variants) == 100
    assert compared < 200

    class Seed(int):
        """Counts comparisons."""

        def __eq__(self, other: object) -> bool:
            nonlocal compared
            compared += 1
            return int(self) == other

        __hash__ = int.__hash__

    compared = 0
    seeds = [Seed(number) for number in range(500)]
    assert _seeds(Source("", values={"seeds": seeds})) == tuple(range(500))
    assert compared < 2000
