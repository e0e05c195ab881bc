"""Finite-state machines as SCXML."""

import json
import subprocess
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from swarmwright import Controller, InputError
from swarmwright.controllers import REPRESENTATIONS, scxml
from swarmwright.export.scxml import Scxml
from swarmwright.export.sequences import draw_random_sequences
from swarmwright.export.subject import Subject
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
    sequences = draw_random_sequences(made.specification, 300)
    assert exporter.run(tmp_path, "walker", sequences).tobytes() == sequences.actuators.tobytes()
    again = scxml.read(tmp_path / "walker.scxml").specification()
    assert again == {**made.specification, "weights": again["weights"]}
    weights = [np.array(one["weights"], np.float32) for one in (again, made.specification)]
    assert weights[0].tolist() == weights[1].tolist()
    assert Controller(again).sensors == 3


def test_names_are_identifiers() -> None:
    from swarmwright.controllers.scxml._write import make_identifiers

    names = ["goal x", "goal-x", "1st", "and", "", "N free", "goal_x_2"]
    found = make_identifiers(names)
    assert found == ["goal_x", "goal_x_2", "_1st", "and_", "value", "N_free", "goal_x_2_2"]


RESERVED = ["class", "lambda", "state0", "In", "arguments"]
"""Words of ECMAScript, of Python, with which conditions are read back, and of the chart itself."""


def test_reserved_words_are_no_names(tmp_path: Path) -> None:
    described = {"sensor_names": RESERVED[:3], "actuator_names": RESERVED[3:]}
    made = replace(machine(3, states=2, levels=2), description=described, facts=(("Run", "a---b"),))
    text = str(Scxml().files(made, "walker")["walker.scxml"])
    (tmp_path / "walker.scxml").write_text(text, encoding="utf-8")
    root = ET.fromstring(text)
    ids = [one.attrib["id"] for one in root.iter() if "id" in one.attrib]
    assert len(set(ids)) == len(ids)
    words = [one.attrib["id"] for one in root.iter("{http://www.w3.org/2005/07/scxml}data")]
    assert words == ["class_", "lambda_", "state0_", "In_", "arguments_"]
    # Read back under the names that they have in the simulation.
    again = scxml.read(tmp_path / "walker.scxml").specification(RESERVED[:3], RESERVED[3:])
    assert again["thresholds"] == made.specification["thresholds"]
    assert again["weights"] == np.array(made.specification["weights"], np.float32).tolist()
    sequences = draw_random_sequences(made.specification, 50)
    assert Scxml().run(tmp_path, "walker", sequences).tobytes() == sequences.actuators.tobytes()


@pytest.mark.slow
def test_no_reserved_word_of_ecmascript_is_left() -> None:
    from swarmwright.controllers.scxml import _write

    words = _write.make_identifiers(sorted(_write._RESERVED))
    program = (
        f'"use strict"; for (const one of {json.dumps(words)}) new Function(`"use strict"; var ${{one}}`);'
    )
    done = subprocess.run(["node", "-e", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_other_kinds_are_refused() -> None:
    kind = REPRESENTATIONS.get("layered")
    made = kind(kind.options_model(), sensors=3, actuators=2)
    with pytest.raises(InputError, match="'layered' cannot be exported to scxml, only mealy_fsm"):
        Scxml().files(subject(made.specification(np.zeros(made.genome_size, np.float32))), "x")
