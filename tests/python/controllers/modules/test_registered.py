"""What is said of modules that are not right."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Controller, Experiment, InputError, RunError, evaluate
from swarmwright.common.random_numbers import Stream
from swarmwright.controllers.kinds.modules.representation import Modules, ModulesOptions
from swarmwright.experiment.derived import has_python_modules
from tests.python.controllers.modules.conftest import CODE, POINTS

Install = Callable[..., Path]
EXPERIMENT: dict[str, Any] = {
    "simulation": "arena",
    "parameters": {"mission": "aac", "robot": "e-puck-rm1.2", "robots": 3, "duration": 3},
    "controller": {"kind": "modules", "behaviours": ["wander"], "conditions": ["timer"], "states": 2},
    "method": {"kind": "random_search", "generations": 1, "population": 2},
}


def refusal(**controller: Any) -> str:
    with pytest.raises(InputError) as caught:
        Experiment.from_mapping({**EXPERIMENT, "controller": {**EXPERIMENT["controller"], **controller}})
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_unknown_modules_are_named(own: Path) -> None:  # noqa: ARG001 - installs the modules
    message = refusal(behaviours=["wandr"])
    assert "unknown behaviour 'wandr'; did you mean 'wander'?" in message
    assert "exploration" in message
    assert "unknown condition 'wander'" in refusal(conditions=["wander"])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("Parameter(0.01, 0.5)", "Parameter(0.5, 0.01)", "parameter 'chance': low, 0.5, must be smaller"),
        ("Parameter(0.01, 0.5)", "Parameter(0.5, 0.5)", "must be smaller than high, 0.5"),
        ("Parameter(0.01, 0.5)", "(0.01, 0.5)", "parameter 'chance': is (0.01, 0.5), expected Parameter("),
        ("Parameter(0.01, 0.5)", "Parameter(0.01, float('inf'))", "inf is not a number of"),
        ("Parameter(0.01, 0.5)", "Parameter('a', 1)", "'a' is not a number of -1e+06 to 1e+06"),
        ("Parameter(1, 20, integer=True)", "Parameter(1, 2.5, True)", "2.5 is not an integer"),
        ('"chance"', '"to"', "parameter 'to': the name must be an identifier other than behaviour"),
        ('"chance"', '"a chance"', "parameter 'a chance': the name must be an identifier"),
        ("    state = 1\n\n    def act", "    state = -1\n\n    def act", "state must be an integer of 0 to"),
        ("def act", "def acts", "own_modules.py:7: behaviour 'wander' (Wander): does not define act()"),
        ("Wander(Behaviour)", "Wander", "is not a subclass of swarmwright.controllers.modules.Behaviour"),
        ('"""Two modules."""', "nonsense", "cannot be imported: NameError"),
    ],
)
def test_a_module_that_is_not_right(install: Install, old: str, new: str, message: str) -> None:
    assert old in CODE
    install(CODE.replace(old, new, 1))
    assert message in refusal()


def test_names_of_the_engine_cannot_be_taken(install: Install) -> None:
    install(points=POINTS.replace("wander =", "stop ="))
    options = ModulesOptions(behaviours=["stop", "exploration"])
    assert not options.in_python


def test_parameters_of_a_subtree_have_different_names(install: Install) -> None:
    install(CODE.replace('"after"', '"steps"'))
    message = refusal(form="tree")
    assert "'steps' is a parameter of a behaviour and of a condition" in message
    assert has_python_modules(Experiment.from_mapping(EXPERIMENT))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "        turning = state",
            "        1 / 0\n        turning = state",
            ":14: wander: act: ZeroDivisionError",
        ),
        ('parameters["chance"]', 'parameters["chanc"]', ":15: wander: act: KeyError: 'chanc'"),
        (", axis=1)", ", axis=0)", "wander: act: returns an array of the shape (2, 6), expected (6, 2)"),
        ("-0.5, 1.0)", "-0.5, np.nan)", "wander: act: returns a number that is not finite"),
        (
            "np.stack([left, np.ones(len(left))], axis=1)",
            "'left'",
            "wander: act: returns str, expected an array",
        ),
        (
            "        turning = state",
            "        self.steps = getattr(self, 'steps', 0) + 1\n        turning = state",
            "wander: act: changes self.steps, which is shared by all robots of all episodes",
        ),
    ],
)
def test_a_module_that_fails_ends_with_a_line(install: Install, old: str, new: str, message: str) -> None:
    assert old in CODE
    install(CODE.replace(old, new, 1))
    experiment = Experiment.from_mapping(EXPERIMENT)
    representation = experiment.representation()
    genomes = np.stack([representation.initial(Stream(1, "x", 0, index)) for index in range(2)])
    with pytest.raises(RunError) as caught:
        evaluate(experiment, genomes)
    assert message in str(caught.value)
    assert "own_modules.py:" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_constant_may_be_made_at_the_first_call(install: Install) -> None:
    """Runs whose modules do this are stored."""
    first = "        turning = state"
    install(
        CODE.replace(
            first, f"        if not hasattr(self, 'gains'):\n            self.gains = np.ones(2)\n{first}", 1
        )
    )
    experiment = Experiment.from_mapping(EXPERIMENT)
    genome = experiment.representation().initial(Stream(1, "x", 0, 0))
    once, again = (evaluate(experiment, genome[np.newaxis]) for _ in range(2))
    assert np.isfinite(once).all()
    assert once.tobytes() == again.tobytes()


def test_a_design_knows_the_ranges_that_it_was_made_with(install: Install) -> None:
    install()
    options = ModulesOptions(behaviours=["wander"], conditions=["timer"])
    subject = Modules(options, sensors=9, actuators=2)
    specification = subject.specification(subject.initial(Stream(1, "x")))
    install(CODE.replace("Parameter(1, 20", "Parameter(1, 30"))
    with pytest.raises(InputError, match="behaviour 'wander': its parameters or their ranges have changed"):
        Controller(specification)
