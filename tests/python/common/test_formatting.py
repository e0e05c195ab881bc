"""Numbers and names as text."""

import pytest

from swarmwright.common.formatting import format_amount, kind_of, shorten


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0.00"), (12.3, "12.30"), (0.1, "0.10"), (0.0949, "0.095"), (1 / 300, "0.0033"),
        (0.000123, "0.00012"), (0.0000123, "0.000012"), (1e-9, "0"),
    ],
)  # fmt: skip
def test_small_amounts_keep_their_digits(value: float, text: str) -> None:
    assert format_amount(value) == text


@pytest.mark.parametrize(
    ("text", "most", "shown"),
    [
        ("a b", 3, "a b"),
        ("", 3, ""),
        ("several words", 10, "several w…"),
        ("several words", 9, "several…"),
        ("x" * 70, 10, "xxxxxxxxx…"),
        ("群れの実験", 10, "群れの実験"),
        ("群れの実験", 9, "群れの実…"),
        ("群れの実験", 8, "群れの…"),
    ],
)
def test_long_texts_are_cut_by_letters(text: str, most: int, shown: str) -> None:
    assert shorten(text, most) == shown


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("server 3: episode 12 failed after 0.5 s", "server 14: episode 1 failed after 12 s"),
        ("log.csv:3: distance is 1e-05", "log.csv:12: distance is 0.25"),
        ("log.csv:3: distance is 1e-05", "log.csv:3: distance is 2.5E+20"),
        ("free(): invalid pointer 0x55d0c1a2b3c4", "free(): invalid pointer 0x7ffe12abcdef"),
        ("free(): invalid pointer 0x55d0c1a2b3c4", "free(): invalid pointer 0x000012ab0000"),
        ("cannot read /tmp/run-1/log.csv", "cannot read /tmp/run-27/other/log.csv"),
        ("cannot read '/tmp/a/log-1.csv'", "cannot read '/tmp/b/log-23.csv'"),
        ("see /tmp/instance-0/failed-7a", "see /tmp/instance-1/failed-8b"),
        ("cannot read /tmp/field1.txt", "cannot read /tmp/field23.txt"),
        ("the folder /tmp/failed-12/ stays", "the folder /tmp/failed-345/ stays"),
        ("was ended by signal 6 after 3 s", "was ended by signal 6 after 4 s"),
    ],
)
def test_what_differs_in_numbers_addresses_or_folders_is_of_one_kind(one: str, other: str) -> None:
    assert kind_of(one) == kind_of(other)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("was ended by signal 6", "was ended by signal 11"),
        ("ended with exit status 1", "ended with exit status 134"),
        ("exit code 3", "exit code 137"),
        ("ended with status 1", "ended with status 2"),
        ("HTTP 404", "HTTP 500"),
        ("cannot read /d/field.txt", "cannot read /d/robot.txt"),
        ("cannot read /d/field1.txt", "cannot read /d/robot1.txt"),
        ("distance is nan", "distance is 0.5"),
        ("signal 6 of 10", "signal 16 of 10"),
    ],
)
def test_other_reasons_are_of_other_kinds(one: str, other: str) -> None:
    assert kind_of(one) != kind_of(other)


def test_urls_and_relative_paths_stay() -> None:
    assert kind_of("server 12 is at https://host/a/b") == "server 0 is at https://host/a/b"
    assert kind_of("./out/run-3/log") == "./out/run-0/log"
    assert kind_of("no answer of 10.0.0.12:1883") == kind_of("no answer of 10.0.0.13:1884")
