"""Tables that commands write: which of their lines are rows."""

import pytest

from swarmwright.simulations.command import logs
from swarmwright.simulations.command.process import CommandFailure


def column(text: str, name: str = "distance", file: str = "r.csv") -> list[float]:
    return list(logs.read({file: text.encode()}, "auto", [name])[name])


@pytest.mark.parametrize(
    "text",
    [
        "step,distance\n0,1\n#2,100\n3,2\n",
        "step,distance\n#2,100\n0,1\n3,2\n",
        "step,distance\n0,1\n3,2\n#2,100\n",
        "step,distance\n0,1\n # 2,100\n3,2\n",
        "step;distance\n0;1\n#2;100\n3;2\n",
        '# step,distance\n0,1\n#2,"100\n3,2\n',
        "#step,distance\n#-1,100\n0,1\n# note\n3,2\n",
        "distance\n1\n#100\n2\n",
    ],
)
def test_lines_that_begin_with_a_hash_never_count(text: str) -> None:
    assert column(text) == [1, 2]
    if ";" not in text:
        assert column(text.replace(",", "\t"), file="r.tsv") == [1, 2]


def test_a_value_in_quotes_may_begin_with_a_hash() -> None:
    assert column('name,distance\n"#a",1\nb,2\n') == [1, 2]
    assert column('name,distance\n"two\n#lines",1\nb,2\n') == [1, 2]


def test_places_count_comments() -> None:
    with pytest.raises(CommandFailure, match=r"^r\.csv:5: has 1 value, expected 2 columns"):
        column("# a\nstep,distance\n#x\n0,1\n3\n")


@pytest.mark.parametrize(
    "row",
    [
        "s,m",
        "[s],[m]",
        "(s),(m/s)",
        "-,m",
        ",m",
        "ms,m/s^2",
        "s,%",
        "[],[arbitrary unit]",
        "1/s,N*m",
        "s,kWh",
        "steps,deg",
    ],
)
def test_a_row_of_units_does_not_count(row: str) -> None:
    assert column(f"step,distance\n{row}\n0,1\n3,2\n") == [1, 2]
    assert column(f"step,distance\n{row}\n0,nan\n3,2\n")[1:] == [2]


@pytest.mark.parametrize(
    ("row", "following"),
    [
        ("go,there", "1,2"),
        ("s,m", "m,s"),  # states
        ("1,m", "1,2"),
        ("-,-", "1,2"),
        (",", "1,2"),
        ("A,start", "B,end"),
        ("s", ""),
    ],
)
def test_rows_of_text_are_no_units(row: str, following: str) -> None:
    assert not logs.is_unit_row(row.split(","), following.split(","))


def test_units_are_below_the_names_alone() -> None:
    assert len(column("step,distance\n0,1\ns,m\n3,2\n")) == 3
    assert len(column("step,distance\ns,m\n")) == 1
