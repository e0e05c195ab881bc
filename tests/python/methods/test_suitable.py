"""A method that cannot evolve a representation says so before anything starts."""

from typing import Any

import pytest

from swarmwright import Experiment, InputError
from swarmwright.common.registry import Registry
from swarmwright.controllers import REPRESENTATIONS
from swarmwright.controllers.kinds.layered import Layered, LayeredOptions
from swarmwright.methods import METHODS
from swarmwright.methods.plug_ins import REGISTRIES
from swarmwright.testing._methods import Choices
from tests.python.methods.functions import new
from tests.python.methods.needed import method_of

COMPUTING = [
    "cma_es",
    "cuckoo_search",
    "de",
    "evostick",
    "openai_es",
    "pgpe",
    "pso",
    "sep_cma_es",
    "snes",
    "tpe",
    "xnes",
]


class Table(Layered):
    """A representation whose genes are choices."""

    continuous = False


@pytest.fixture
def table(monkeypatch: pytest.MonkeyPatch) -> None:
    """`layered` is discrete for the time of a test."""
    registry: Registry[Any] = Registry(
        "controller",
        "",
        {**REPRESENTATIONS.built_in, "layered": f"{__name__}:Table"},
        "swarmwright.controllers:Representation",
    )
    monkeypatch.setattr(registry, "_load", lambda _: Table)
    monkeypatch.setitem(REGISTRIES, "controller", registry)
    monkeypatch.setattr("swarmwright.experiment.experiment.REPRESENTATIONS", registry)


@pytest.mark.parametrize("kind", COMPUTING)
@pytest.mark.usefixtures("table")
def test_an_experiment_is_refused_with_file_and_line(kind: str, tmp_path: Any) -> None:
    path = tmp_path / "x.yaml"
    path.write_text(f"simulation: minisim\nmethod:\n  generations: 3\n  kind: {kind}\n")
    with pytest.raises(InputError) as caught:
        Experiment.load(path)
    expected = f"x.yaml:4: method.kind: {kind} cannot evolve layered: its genes are choices"
    assert expected in str(caught.value)
    assert "use nnga, cea2d, racing or random_search" in str(caught.value)


def test_groups_whose_genes_are_choices_are_named() -> None:
    groups = {"agents": {"kind": "layered"}, "defenders": {"kind": "mealy_fsm"}}
    with pytest.raises(InputError, match=r"pso cannot evolve team: the genes of defenders \(mealy_fsm\) are"):
        Experiment.from_mapping(
            {
                "simulation": "minisim",
                "parameters": {"defenderSteering": "controller"},
                "controller": {"kind": "team", "groups": groups},
                "method": {"kind": "pso"},
            }
        )


@pytest.mark.usefixtures("table")
@pytest.mark.parametrize("kind", sorted(set(METHODS.built_in) - {*COMPUTING, "neat"}))
def test_methods_that_leave_variation_to_the_representation_take_it(kind: str) -> None:
    experiment = Experiment.from_mapping({"simulation": "minisim", "method": method_of(kind)})
    assert len(experiment.new_method(experiment.representation()).ask()) > 0


@pytest.mark.usefixtures("table")
def test_without_sensors_it_is_found_out_when_they_are_known() -> None:
    experiment = Experiment.from_mapping({"simulation": "elsewhere", "method": {"kind": "pso"}})
    with pytest.raises(InputError, match=r"method\.kind: pso cannot evolve layered"):
        experiment.new_method(experiment.representation(4, 1))


def test_several_problems_are_told_at_once() -> None:
    with pytest.raises(InputError) as caught:
        Experiment.from_mapping(
            {
                "simulation": "minisim",
                "controller": {"hidden": [2000]},
                "method": {"kind": "cma_es", "operation": "steady_state"},
            }
        )
    first, second = str(caught.value).splitlines()
    assert "method.operation: cma_es cannot work in steady state" in first
    assert (
        "method.kind: cma_es cannot evolve layered: 12001 genes are too many for a covariance matrix"
        in second
    )


def test_populations_that_need_too_much_memory_are_refused() -> None:
    with pytest.raises(
        InputError, match=r"method\.population: 1,000,000 genomes of 4,861 genes .* at most 822,875"
    ):
        Experiment.from_mapping(
            {
                "simulation": "minisim",
                "controller": {"hidden": [810]},
                "method": {"kind": "de", "population": 1_000_000},
            }
        )


def test_a_method_made_by_hand_refuses_as_well() -> None:
    with pytest.raises(InputError, match=r"method\.kind: de cannot evolve sample"):
        new("de", subject=Choices())
    assert new("nnga", subject=Choices()).ask().shape == (50, 12)
    assert LayeredOptions().kind == "layered"
