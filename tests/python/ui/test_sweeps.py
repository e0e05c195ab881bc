"""Sweeps that are entered in a form become sweep files with the same values."""

from pathlib import Path

import pytest

from swarmwright import InputError
from swarmwright.analysis.sweep import Sweep
from swarmwright.ui.fields import Kinds, describe_form
from swarmwright.ui.sweeps import name_key, plan_sweep

EXPERIMENT = """\
simulation: {command: ./simulate, log: stdout, controller: json, sensors: 1, actuators: 1}
parameters: {seed: 5, "a.b": 2}
"""


def test_names_and_values_keep_their_quotes(tmp_path: Path) -> None:
    """Names with dots, colons and brackets; values that YAML would read as something else."""
    entries: dict[str, tuple[str, list[object]]] = {
        "a.b": ("1, 2", [1, 2]),
        "c: d": ("'007', 'yes', '2020-01-01', 'x, y'", ["007", "yes", "2020-01-01", "x, y"]),
        "e[0]": ("yes", ["yes"]),
        "f=g": ("'#'", ["#"]),
        "1": ("0x10", [16]),
    }
    vary = [{"path": ["parameters", name], "values": text} for name, (text, _) in entries.items()]
    plan = plan_sweep(EXPERIMENT, vary, 1, describe_form(Kinds("command", is_mapping=True)))
    assert plan.errors == {}
    (tmp_path / "simulate").write_text("")
    (tmp_path / "own.yaml").write_text(EXPERIMENT)
    (tmp_path / "sweep.yaml").write_text(plan.write("own.yaml"))
    variants = Sweep.load(tmp_path / "sweep.yaml").variants
    for name, (_, values) in entries.items():
        assert {variant.experiment.parameters[name] for variant in variants} == set(values)
    assert {len(variant.experiment.parameters) for variant in variants} == {len(entries) + 1}  # and the seed


def test_a_name_with_quotes_cannot_be_written() -> None:
    with pytest.raises(InputError, match="a key with quotes cannot be varied"):
        name_key(("parameters", 'a"b'))
