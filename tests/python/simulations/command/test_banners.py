"""What libraries print among a log on standard output."""

import pytest

from swarmwright.simulations.command import logs
from swarmwright.simulations.command.definition import STANDARD_OUTPUT
from swarmwright.simulations.command.process import CommandFailure

BANNER = "pygame 2.6.1 (SDL 2.28.4, Python 3.11.2)\nHello from the pygame community. See x.org, please.\n"


def read(text: str, form: str = "auto", name: str = STANDARD_OUTPUT) -> list[float]:
    return logs.read({name: text.encode()}, form, ["x"])["x"]


@pytest.mark.parametrize("form", ["auto", "jsonl"])
def test_lines_of_json_after_and_between_others(form: str) -> None:
    text = f'{BANNER}{{"x": 1}}\nWARNING: slow\n  {{"x": 2.5}}\n'
    assert read(text, form) == [1.0, 2.5]
    with pytest.raises(CommandFailure, match=r"stdout:4: is not valid JSON: .*; was the log cut off"):
        read(f'{BANNER}{{"x": 1}}\n{{"x": \n', form)


def test_one_object_over_several_lines() -> None:
    assert read(f'{BANNER}[{{"x": 1}},\n {{"x": 2}}]\n', "json") == [1.0, 2.0]
    assert read('{\n"x": 1\n}\n', "json") == [1.0]


@pytest.mark.parametrize("form", ["auto", "csv"])
def test_tables_begin_with_the_names_of_their_columns(form: str) -> None:
    assert read(f"{BANNER}# 3 robots\nx,y\n1,2\n3,4\n", form) == [1.0, 3.0]
    assert read("# x,y\n1,2\n", form) == [1.0]
    with pytest.raises(CommandFailure, match="stdout:5: has 1 value, expected 2 columns"):
        read(f"{BANNER}x,y\n1,2\n3\n", form)


def test_other_files_have_no_banner() -> None:
    with pytest.raises(CommandFailure, match=r"log\.jsonl:1: is not valid JSON"):
        read(f'{BANNER}{{"x": 1}}\n', name="log.jsonl")


def test_without_the_column_what_was_printed_first_is_told() -> None:
    with pytest.raises(CommandFailure, match="stdout: has no column 'x'"):
        read("a,b\n1,2\n")
