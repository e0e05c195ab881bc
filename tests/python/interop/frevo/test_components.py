"""Which of FREVO's components are taken over, and what stands in the place of the others."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, InputError, frevo, optimize
from swarmwright.controllers.kinds.fully_meshed import FullyMeshedOptions
from swarmwright.controllers.kinds.hebbian import HebbianOptions
from swarmwright.controllers.kinds.layered import LayeredOptions
from swarmwright.controllers.kinds.mealy_fsm import MealyFsmOptions
from swarmwright.controllers.kinds.neat import NeatOptions
from swarmwright.methods.cuckoo_search import CuckooSearchOptions
from swarmwright.methods.ga_species import GaSpeciesOptions, SpeciesOptions
from swarmwright.methods.map_elites import Measure
from swarmwright.methods.novelty import NoveltyOptions
from swarmwright.methods.pso import PsoOptions
from swarmwright.methods.random_search import RandomSearchOptions

Session = Callable[..., Path]
Entries = dict[str, object]
FIRST = {
    "problem": "emergencyexit.EmergencyExit",
    "method": "nnga.NNGA",
    "representation": "fullyMeshedNet.FullyMeshedNet",
    "ranking": "AbsoluteRanking.AbsoluteRanking",
}
SIMULATION = """
import numpy as np
from swarmwright import Simulation

class Two(Simulation):
    sensors = 2
    actuators = 1
    max_agents = 1
    def reset(self, parameters, seed):
        self.sum = 0.0
        return np.array([[0.5, -0.5]])
    def step(self, actions):
        self.sum += float(actions[0, 0])
        return np.array([[0.5, -0.5]])
    def done(self):
        return self.sum != 0
    def fitness(self):
        return self.sum
"""


@pytest.fixture
def session(tmp_path: Path) -> Session:
    """Writes a session; components not named are those of FIRST, entries not given are left out."""

    def make(*, given: dict[str, Entries] | None = None, **components: str) -> Path:
        classes, entries = {**FIRST, **components}, dict(given or {})
        if classes["problem"] == FIRST["problem"]:
            entries["problem"] = {"fieldsource": "RANDOM_FIELD"}
        lines = ["<frevo>"]
        for name, component in classes.items():
            lines.append(f'<{name} class="{component}">')
            for key, value in entries.get(name, {}).items():
                kind = "INT" if isinstance(value, int) else "STRING"
                lines.append(f'<{name}entry key="{key}" type="{kind}" value="{value}"/>')
            lines.append(f"</{name}>")
        path = tmp_path / "some.zse"
        path.write_text("\n".join([*lines, "</frevo>"]))
        return path

    return make


LAYERS = "threeLayerNetwork.ThreeLayerNetwork"
MANY = "multiLayerNetwork.MultiLayerNetwork"
HEBBIAN = "hebbNet.HebbNet"
NEAT = "neat.NEAT"
COMPLETE = "completeNetwork.CompleteNetwork"


@pytest.mark.parametrize(
    ("representation", "given", "expected"),
    [
        (LAYERS, {}, LayeredOptions(hidden=[2], activation="sigmoid")),
        (
            LAYERS,
            {"hiddenNodes": 5, "weight_range": "1.5f", "bias_range": 3, "stepNumber": 7},
            LayeredOptions(hidden=[5], activation="sigmoid", weight_range=1.5, bias_range=3.0),
        ),
        (MANY, {}, LayeredOptions(hidden=[2, 2], activation="sigmoid")),
        (
            MANY,
            {"hidden_layers": 3, "nodes_per_layer": 4},
            LayeredOptions(hidden=[4, 4, 4], activation="sigmoid"),
        ),
        (COMPLETE, {}, FullyMeshedOptions()),
        (COMPLETE, {"hiddenNodes": 3, "stepNumber": 5}, FullyMeshedOptions(hidden=3, iterations=5)),
        (
            FIRST["representation"],
            {"activationFunction": "RELU"},
            FullyMeshedOptions(activation="relu", output_range=[0, 1]),
        ),
    ],
)
def test_networks(session: Session, representation: str, given: Entries, expected: Any) -> None:
    imported = frevo.load(session(representation=representation, given={"representation": given}))
    assert imported.experiment.controller == expected
    assert not any("unknown to FREVO" in note for note in imported.notes)
    assert imported.experiment.representation().architecture()["output_range"] == [0, 1]


def test_imported_networks_evolve(session: Session, tmp_path: Path) -> None:
    for index, representation in enumerate((LAYERS, MANY, COMPLETE, HEBBIAN, NEAT)):
        experiment = frevo.load(session(representation=representation)).experiment
        short = experiment.replace(method={"population": 8, "generations": 1}, servers="local")
        run = optimize(short, out=tmp_path / str(index))
        assert run.evaluations == 8
        assert run.best.fitness < 0


def test_networks_that_learn(session: Session) -> None:
    given = {"hiddenNodes": 3, "stepNumber": 0, "weight_range": "1.5f", "bias_range": 3}
    imported = frevo.load(session(representation=HEBBIAN, given={"representation": given}))
    assert imported.experiment.controller == HebbianOptions(
        hidden=3, iterations=1, weight_range=1.5, bias_range=3.0
    )
    assert any("the learning rate of a HebbNet is mutated" in note for note in imported.notes)
    assert "plasticity of weights: FREVO evolves it, but does not use it" in imported.yaml
    default = frevo.load(session(representation=HEBBIAN)).experiment.controller
    assert default == HebbianOptions()


def test_a_session_with_neat_says_what_is_not_taken_over(session: Session) -> None:
    given = {"recursive": "false", "add_node_prob": "0.01f", "excess_coeff": "2f", "weight_range": "2f"}
    imported = frevo.load(session(representation=NEAT, given={"representation": given}))
    assert imported.experiment.controller == NeatOptions(frevo=True, max_nodes=10, add_node=0.01)
    assert any("from every sensor to every actuator, and grow" in note for note in imported.notes)
    assert "excess_coeff = 2f: distances are sums of differences" in imported.yaml
    assert any("recursive = false: connections may form cycles here" in note for note in imported.notes)
    assert any("weight_range = 2f: unknown to FREVO 1.5" in note for note in imported.notes)


def test_mutation_of_layers_in_proportion_is_said_to_differ(session: Session) -> None:
    imported = frevo.load(session(representation=LAYERS, given={"method": {"mutationMethod": 2}}))
    assert vars(imported.experiment.controller)["mutation"] == "proportional"
    assert any("weights and biases move by up to a fifth of their size" in note for note in imported.notes)


def test_a_machine_of_which_everything_is_left_out(session: Session, tmp_path: Path) -> None:
    # FREVO has two inputs by default; where a problem has others, 0 to 100 with one threshold for each.
    imported = frevo.load(session(representation="fsm.MealyFSM"))
    assert imported.experiment.controller == MealyFsmOptions(
        states=6, levels=[[49.5]] * 10, output_levels=101
    )
    assert any("takes every input for a number from 0 to 100 with 1 threshold" in x for x in imported.notes)
    (tmp_path / "two.py").write_text(SIMULATION)
    two = frevo.load(session(representation="fsm.MealyFSM"), simulation=str(tmp_path / "two.py:Two"))
    assert two.experiment.controller == MealyFsmOptions(
        states=6, levels=[[17.5, 34.5, 52.5]] * 2, output_levels=101
    )


def test_a_machine_of_which_the_thresholds_are_left_out(session: Session) -> None:
    lists = {
        "min_input_values": "-20,-20,0,0,0,0,0,0,0,0",
        "max_input_values": "20,20,1,1,1,1,1,1,1,1",
        "unit_input_values": "40,40,1,1,1,1,1,1,1,1",
    }
    imported = frevo.load(session(representation="fsm.MealyFSM", given={"representation": lists}))
    levels = vars(imported.experiment.controller)["levels"]
    assert levels == [[-10.5, -0.5, 9.5]] * 2 + [[0.5]] * 8


def test_random_search(session: Session) -> None:
    name = "frevo.method.randomsearch.RandomSearch"
    assert frevo.load(session(method=name)).experiment.method == RandomSearchOptions()
    given: dict[str, Entries] = {"method": {"populationsize": 7, "generations": 9}}
    imported = frevo.load(session(method=name, given=given))
    assert imported.experiment.method == RandomSearchOptions(population=7, generations=9)


def test_particle_swarms(session: Session) -> None:
    imported = frevo.load(session(method="pso.PSO"))
    assert imported.experiment.method == PsoOptions(
        population=100,
        inertia=0.7,
        own=2.4,
        social=2.1,
        adaptive=False,
        perturb=False,
        reach=1.0,
        fastest=0.5,
    )
    assert any("C1 has no effect" in note for note in imported.notes)
    given: dict[str, Entries] = {
        "method": {"W": "0.5", "C1": "1.5f", "C2": "1", "populationsize": 30, "generations": 4},
        "representation": {"weight_range": "0.5f"},
    }
    method: Any = frevo.load(session(method="pso.PSO", representation=LAYERS, given=given)).experiment.method
    assert (method.inertia, method.own, method.social, method.fastest) == (0.5, 1.5, 1.0, 1.0)
    assert (method.population, method.generations) == (30, 4)


def test_species(session: Session) -> None:
    name = "gaspecies.GASpecies"
    imported = frevo.load(session(method=name))
    fixed: dict[str, Any] = {"severity": 1.0, "probability": 1.0}
    assert imported.experiment.method == GaSpeciesOptions(generations=201, **fixed)
    given: dict[str, Entries] = {
        "method": {
            "populationsize": 30,
            "generations": 9,
            "initial_compatibility_threshold": "4",
            "survival_threshold": "0.3f",
            "mutate_only_probablity": "0.5f",
            "interspecies_mate_rate": "0.2f",
            "mate_only_prob": "0.1",
            "save_interval": 5,
        }
    }
    imported = frevo.load(session(method=name, given=given))
    assert imported.experiment.method == GaSpeciesOptions(
        population=30, generations=10, compatibility=4, survival=0.3, mutate=0.5, within=0.2,
        crossover_only=0.1, **fixed,
    )  # fmt: skip
    assert not any("unknown to FREVO" in note for note in imported.notes)
    given = {"method": {"time_alive_minimum": 3}}
    with pytest.raises(InputError, match=r"method\.time_alive_minimum: 3 found; .*: set it to 0"):
        frevo.load(session(method=name, given=given))


def test_cuckoos(session: Session) -> None:
    name = "frevo.cuckoosearch.CuckooSearch"
    imported = frevo.load(session(method=name))
    assert imported.experiment.method == CuckooSearchOptions(generations=401)
    assert any("ignores discovery_rate" in note for note in imported.notes)
    given: dict[str, Entries] = {
        "method": {"number_of_nests": 7, "discovery_rate": "0.5", "generations": 3},
    }
    imported = frevo.load(session(method=name, given=given))
    assert imported.experiment.method == CuckooSearchOptions(population=7, discovery=0.5, generations=7)


@pytest.mark.parametrize("method", ["gaspecies.GASpecies", "frevo.cuckoosearch.CuckooSearch"])
def test_imported_methods_evolve(session: Session, tmp_path: Path, method: str) -> None:
    experiment = frevo.load(session(method=method)).experiment
    short = experiment.replace(method={"population": 8, "generations": 20}, servers="in-process")
    run = optimize(short, out=tmp_path / "run")
    assert run.history[-1].best_so_far > run.history[0].best_so_far


MEASURES = {name: Measure(range=[0, 1], bins=10) for name in ("distance", "finished", "out")}
THRESHOLD: dict[str, Any] = {"kind": "threshold", "threshold": 6.0}


def test_novelty_search(session: Session, tmp_path: Path) -> None:
    name = "fehervari.noveltysearch.NoveltySearch"
    given: dict[str, Entries] = {
        "method": {"populationsize": 30, "generations": 4, "mutate_only_probablity": "0.4f"},
    }
    imported = frevo.load(session(method=name, given=given))
    expected = {
        "population": 30,
        "generations": 5,
        "elite": 0.5,
        "mutate": 0.2,
        "crossover": 0.3,
        "random": 0,
    }
    options = {"renew": 0, "probability": 0.1, "distance": "manhattan", "archive": THRESHOLD}
    assert imported.experiment.method == NoveltyOptions.model_validate(
        {**expected, **options, "measures": MEASURES}
    )
    assert any("all metrics of the simulation do, unscaled" in note for note in imported.notes)
    assert not any("unknown to FREVO" in note for note in imported.notes)
    run = optimize(imported.experiment.replace(servers="in-process"), out=tmp_path / "run")
    assert run.elites.kind == "archive"
    default = frevo.load(session(method=name)).experiment.method.model_dump()
    assert (default["population"], default["mutate"], default["crossover"]) == (100, 0.15, 0.35)


def test_novelty_of_species(session: Session) -> None:
    name = "fehervari.noveltyspecies.NoveltySpecies"
    given: dict[str, Entries] = {"method": {"populationsize": 250, "initial_compatibility_threshold": "4"}}
    imported = frevo.load(session(method=name, given=given))
    assert imported.experiment.method == NoveltyOptions.model_validate(
        {
            "population": 250,
            "generations": 201,
            "species": SpeciesOptions(compatibility=4),
            "severity": 1,
            "distance": "manhattan",
            "archive": THRESHOLD,
            "measures": MEASURES,
        }
    )


def test_novelty_as_a_ranking(session: Session) -> None:
    name = "fehervari.noveltyranking.NoveltyRanking"
    given: dict[str, Entries] = {"method": {"populationsize": 20}, "ranking": {"initial_threshold": "3f"}}
    imported = frevo.load(session(ranking=name, given=given))
    archive = {"kind": "threshold", "threshold": 3.0}
    assert imported.experiment.method == NoveltyOptions.model_validate(
        {"population": 20, "distance": "manhattan", "archive": archive, "measures": MEASURES}
    )
    with pytest.raises(InputError, match=r"NoveltyRanking is converted with nnga\.NNGA only"):
        frevo.load(session(ranking=name, method="CEA2D.CEA2D"))
    with pytest.raises(InputError, match=r"replace the ranking with --ranking"):
        frevo.load(session(ranking=name, problem="light.Light"), simulation="unknown one")
    plain = frevo.load(session(ranking=name), ranking="absolute").experiment.method
    assert plain.kind == "nnga"


def test_shares_in_percent_of_early_versions(session: Session) -> None:
    shares = {"elite": 15, "random": 10, "mutate": 40, "xover": 30, "renew": 5}
    given: dict[str, Entries] = {"method": {f"percentage_{key}": value for key, value in shares.items()}}
    imported = frevo.load(session(given=given))
    method = imported.experiment.method.model_dump()
    assert [method[key] for key in ("elite", "random", "mutate", "crossover", "renew")] == [
        0.15, 0.1, 0.4, 0.3, 0.05,
    ]  # fmt: skip
    assert any("whole numbers are read as percentages" in note for note in imported.notes)


def test_templates_have_the_defaults_where_something_is_to_be_filled_in(session: Session) -> None:
    given: dict[str, Entries] = {
        "method": {"populationsize": "-POPSIZE-"},
        "ranking": {"parallelthreads": "-PARALLELTHREADS-"},
    }
    imported = frevo.load(session(given=given))
    assert imported.experiment.method.model_dump()["population"] == 50
    assert "method.populationsize = -POPSIZE-: a placeholder; FREVO's default is used" in imported.notes


@pytest.mark.slow
def test_everything_without_a_counterpart_is_named_at_once(session: Session, program: Any) -> None:
    path = session(
        problem="cam.Cam",
        method="own.Own",
        representation="bulk.Bulk",
        ranking="own.Ranking",
    )
    shown = program("import", path)
    assert (shown.returncode, shown.stdout) == (2, "")
    lines = shown.stderr.removeprefix("swarmwright: ").splitlines()
    assert [line.strip().split(" has no counterpart in Swarmwright")[0] for line in lines] == [
        f"{path}:2: <problem>: the class 'cam.Cam'",
        f"{path}:4: <method>: the class 'own.Own'",
        f"{path}:6: <representation>: the class 'bulk.Bulk'",
        f"{path}:8: <ranking>: the class 'own.Ranking'",
    ]
    for line, option in zip(lines, ("simulation", "method", "controller", "ranking"), strict=True):
        assert f"with --{option}" in line


def test_entries_of_all_sections_are_complained_about_at_once(session: Session) -> None:
    given: dict[str, Entries] = {
        "method": {"populationsize": "x"},
        "representation": {"random_source": "true"},
    }
    with pytest.raises(InputError) as caught:
        frevo.load(session(problem="cam.Cam", given=given))
    assert [line.split(": ")[1] for line in str(caught.value).splitlines()] == [
        "<problem>",
        "method.populationsize",
        "representation.random_source",
    ]


@pytest.mark.slow
def test_another_simulation_is_taken_in_the_place_of_the_problem(
    session: Session, program: Any, tmp_path: Path
) -> None:
    (tmp_path / "deep").mkdir()
    (tmp_path / "two.py").write_text(SIMULATION)
    given: dict[str, Entries] = {
        "problem": {"evalnumber": 20},
        "method": {"populationsize": 6, "generations": 2},
    }
    path = session(problem="light.Light", representation=LAYERS, given=given)
    made = program("import", path, "--simulation", "two.py:Two", "-o", "deep/two.yaml")
    assert made.returncode == 0, made.stderr
    assert "problem.class = light.Light: " in made.stderr
    text = (tmp_path / "deep" / "two.yaml").read_text()
    assert 'simulation: "../two.py:Two"  # light.Light' in text
    assert "# not imported: evalnumber = 20: an entry of light.Light" in text
    experiment = Experiment.load(tmp_path / "deep" / "two.yaml")
    assert (experiment.sensors, experiment.parameters) == (2, {})
    assert experiment.genome_size == 2 * 3 + 3
    run = optimize(experiment.replace(servers="local"), out=tmp_path / "run")
    assert run.evaluations > 6


def test_a_simulation_of_a_server_can_be_named(session: Session) -> None:
    experiment = frevo.load(session(problem="light.Light"), simulation="light with spaces").experiment
    assert (experiment.simulation, experiment.sensors) == ("light with spaces", None)


def test_other_components_are_taken_in_the_place_of_frevos(session: Session) -> None:
    path = session(
        problem="cam.Cam",
        method="own.Own",
        representation="bulk.Bulk",
        ranking="own.Ranking",
        given={"method": {"populationsize": 12, "generations": 3, "survival_threshold": "0.4"}},
    )
    imported = frevo.load(
        path, simulation="minisim", method="cea2d", controller="fully_meshed", ranking="absolute"
    )
    experiment = imported.experiment
    assert (experiment.simulation, experiment.controller.kind) == ("minisim", "fully_meshed")
    assert (experiment.method.kind, experiment.method.generations) == ("cea2d", 3)
    assert "# not imported: survival_threshold = 0.4: an entry of own.Own" in imported.yaml
    for part in ("cam.Cam", "own.Own", "bulk.Bulk", "own.Ranking"):
        assert any(f"class = {part}" in note and "replaces it" in note for note in imported.notes), part


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ("method", "method: unknown method 'x'; available: "),
        ("controller", "controller: unknown controller 'x'; available: "),
        ("ranking", "ranking: unknown ranking 'x'; available: absolute"),
    ],
)
def test_unknown_kinds_are_refused(session: Session, option: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        frevo.load(session(), **{option: "x"})
    assert words in str(caught.value)
