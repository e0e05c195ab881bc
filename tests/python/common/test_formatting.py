"""Numbers and names as text."""

import pytest

from swarmwright.common.formatting import format_amount, shorten


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
