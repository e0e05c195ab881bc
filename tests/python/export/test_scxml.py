"""Finite-state machines as SCXML."""

from pathlib import Path

import numpy as np
import pytest

from swarmwright import Controller, InputError, scxml
from swarmwright.export.scxml import Scxml
from swarmwright.export.sequences import random_sequences
from swarmwright.export.subject import Subject
from swarmwright.representations import REPRESENTATIONS
from tests.python.export.specifications import subject


def machine(seed: int, **options: object) -> Subject:
    kind = REPRESENTATIONS.get("mealy_fsm")
    made = kind(kind.options_model.model_validate(options), sensors=3, actuators=2)
    drawn = np.random.default_rng(seed)
    lower, upper = made.bounds
    return subject(made.specification(drawn.uniform(lower, upper).astype(np.float32)))


@pytest.mark.parametrize("seed", range(6))
def test_what_is_written_does_the_same(tmp_path: Path, seed: int) -> None:
    levels = [[-0.3, 0.1, 0.7], 1, [0.0]] if seed % 2 else 2
    made = machine(seed, states=1 + seed, levels=levels, output_levels=0 if seed < 3 else 5)
    exporter = Scxml()
    for name, text in exporter.files(made, "walker").items():
        (tmp_path / name).write_text(str(text))
    sequences = random_sequences(made.specification, 300)
    assert exporter.run(tmp_path, "walker", sequences).tobytes() == sequences.actuators.tobytes()
    again = scxml.read(tmp_path / "walker.scxml").specification()
    assert again == {**made.specification, "weights": again["weights"]}
    weights = [np.array(one["weights"], np.float32) for one in (again, made.specification)]
    assert weights[0].tolist() == weights[1].tolist()
    assert Controller(again).sensors == 3


def test_names_are_identifiers() -> None:
    from swarmwright.scxml._write import identifiers

    names = ["goal x", "goal-x", "1st", "and", "", "N free", "goal_x_2"]
    found = identifiers(names)
    assert found == ["goal_x", "goal_x_2", "_1st", "and_", "value", "N_free", "goal_x_2_2"]


def test_other_kinds_are_refused() -> None:
    kind = REPRESENTATIONS.get("layered")
    made = kind(kind.options_model(), sensors=3, actuators=2)
    with pytest.raises(InputError, match="'layered' cannot be exported to scxml, only mealy_fsm"):
        Scxml().files(subject(made.specification(np.zeros(made.genome_size, np.float32))), "x")
