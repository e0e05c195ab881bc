"""Logs in JSON."""

import json
import sys

import pytest

from swarmwright.simulations.command import logs
from swarmwright.simulations.command.process import CommandFailure


def read(text: str, form: str = "jsonl") -> logs.Columns:
    return logs.read({"log": text.encode()}, form, ["x"])


@pytest.mark.parametrize("sign", ["\u2028", "\u2029", "\u0085"])
def test_signs_within_text_end_no_line(sign: str) -> None:
    rows = [json.dumps({"note": f"a{sign}b", "x": number}, ensure_ascii=False) for number in (1, 2.5)]
    text = "\r\n".join([*rows, ""])
    assert read(text) == {"x": [1.0, 2.5]}
    assert read("\n\n".join(rows)) == {"x": [1.0, 2.5]}


def test_lines_are_counted() -> None:
    with pytest.raises(CommandFailure, match=r"log:3: is not valid JSON: .*; was the log cut off"):
        read('{"x": 1}\n\n{"x": \n')


@pytest.mark.parametrize("form", ["json", "jsonl"])
def test_what_is_nested_too_deeply_is_said_to_be(form: str) -> None:
    deep = 200_000
    for text in ("[" * deep + "]" * deep, '{"a":' * deep + "1" + "}" * deep):
        with pytest.raises(CommandFailure, match=r"log.*: is nested too deeply"):
            read(text, form)


def test_objects_that_can_be_read_but_not_flattened_are_said_to_be(monkeypatch: pytest.MonkeyPatch) -> None:
    value: dict[str, object] = {"x": 1}
    for _ in range(sys.getrecursionlimit()):
        value = {"a": value}
    monkeypatch.setattr(json, "loads", lambda _: value)
    with pytest.raises(CommandFailure, match="log:1: is nested too deeply"):
        read("{}")
