"""Fields from JSON files and from FREVO's own."""

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmwright import Experiment, InputError
from swarmwright.interop.frevo import _document

# Written by Java: a field of 4 x 3 cells, and an empty java.util.ArrayList.
SER = bytes.fromhex(
    "aced000573720013656d657267656e6379657869742e4669656c648fd0e8f79d08290402000549000668656967687449000577"
    "696474685b000e456d657267656e637945786974737400115b4c6a6176612f6177742f506f696e743b5b00066167656e747371"
    "007e00015b0009626c6f636b6164657371007e000178700000000300000004757200115b4c6a6176612e6177742e506f696e74"
    "3ba79f482c045764180200007870000000017372000e6a6176612e6177742e506f696e74b6c48a72347ec82602000249000178"
    "49000179787000000003000000027571007e0003000000027371007e000500000000000000007371007e000500000001000000"
    "027571007e0003000000017371007e00050000000200000001"
)
LIST = bytes.fromhex(
    "aced0005737200136a6176612e7574696c2e41727261794c6973747881d21d99c7619d03000149000473697a65787000000000"
    "77040000000078"
)
FIELD = {"width": 4, "height": 3, "exits": [[3, 2]], "agents": [[0, 0], [1, 2]], "blockades": [[2, 1]]}


def test_frevos_field_file(tmp_path: Path) -> None:
    path = tmp_path / "x.ser"
    path.write_bytes(SER)
    assert _document.read_field(path) == FIELD


@pytest.mark.parametrize(
    ("data", "answer"),
    [
        (b"", "is truncated"),
        (b"PK\x03\x04....", "does not begin with the header of a serialized Java object"),
        (SER[:-1], "is truncated"),
        (LIST, "the class java.util.ArrayList has a custom serialization"),
        (SER.replace(b"emergencyexit.Field", b"emergencyexit.Other"), "it contains emergencyexit.Other"),
        (SER.replace(b"java.awt.Point\xb6", b"java.awt.Paint\xb6"), "an object that is not a point"),
    ],
)
def test_another_file_is_refused(tmp_path: Path, data: bytes, answer: str) -> None:
    path = tmp_path / "x.ser"
    path.write_bytes(data)
    with pytest.raises(InputError) as caught:
        _document.read_field(path)
    assert answer in str(caught.value)
    assert str(caught.value).startswith(f"{path}: ")


@given(at=st.integers(0, len(SER) - 1), value=st.integers(0, 255))
def test_no_byte_can_do_harm(tmp_path_factory: pytest.TempPathFactory, at: int, value: int) -> None:
    path = tmp_path_factory.getbasetemp() / "harm.ser"
    path.write_bytes(SER[:at] + bytes([value]) + SER[at + 1 :])
    try:
        field = _document.read_field(path)
    except InputError:
        return
    assert list(field) == ["width", "height", "exits", "agents", "blockades"]


def experiment(folder: Path, value: str) -> Path:
    path = folder / "exit.yaml"
    path.write_text(f"simulation: emergency_exit\nparameters:\n  steps: 3\n  field: {value}\n")
    return path


def test_an_experiment_names_a_field_relative_to_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "field.json").write_text(json.dumps(FIELD))
    monkeypatch.chdir(tmp_path / "elsewhere")
    loaded = Experiment.load(experiment(tmp_path / "a", "../field.json"))
    assert loaded.parameters["field"] == FIELD
    # What is saved holds the field itself, and loads from anywhere.
    loaded.save("saved.yaml")
    assert Experiment.load("saved.yaml") == loaded
    # Without a file paths are relative to where one works.
    values = {"simulation": "emergency_exit", "parameters": {"field": "../field.json"}}
    assert Experiment.from_mapping(values).parameters["field"] == FIELD


@pytest.mark.parametrize(
    ("content", "answer"),
    [
        (None, "exit.yaml:4: parameters.field: {folder}/field.json: there is no such file"),
        ('{"width":\n4,,', "exit.yaml:4: parameters.field: {folder}/field.json:2: is not valid JSON"),
        ("[]", "holds a list; expected an object"),
        ('{"width": NaN}', "NaN is not a finite number"),
        (
            json.dumps({**FIELD, "agents": [[9, 9]]}),
            "exit.yaml:4: parameters.field: {folder}/field.json: agents[0]: [9,9] found",
        ),
    ],
)
def test_a_field_that_cannot_be_read(tmp_path: Path, content: str | None, answer: str) -> None:
    if content is not None:
        (tmp_path / "field.json").write_text(content)
    with pytest.raises(InputError) as caught:
        Experiment.load(experiment(tmp_path, "field.json"))
    assert answer.format(folder=tmp_path) in str(caught.value)
