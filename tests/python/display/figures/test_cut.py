"""What an axis leaves out."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from swarmwright.display.figures.style import cut

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)


def test_first_values_are_cut_off_where_they_would_squash_the_rest() -> None:
    x = np.arange(40.0)
    rising = -1000 * 0.3**x + x
    found = cut([(x, rising - 1, rising + 1)])
    assert found is not None
    assert (found.least, found.low < (rising - 1)[4:].min(), found.low > -100) == (-1001, True, True)
    assert found.high > 40
    assert found.note == "↓ the beginning reaches down to −1001"
    assert cut([(x, x - 1, x + 1)]) is None, "a steady rise needs the room"
    assert cut([(x[:5], rising[:5], rising[:5])]) is None, "too few to tell beginning from rest"
    flat = np.where(x < 2, -9.0, 0.0)
    assert cut([(x, flat, flat)]) is None, "of a flat rest nothing more would be seen"
    late = (1000 * x, rising, rising)
    assert cut([(x, rising, rising), late]) == cut([late, (x, rising, rising)]) is not None, (
        "each its own tenth"
    )


@given(st.lists(st.lists(NUMBERS | st.just(math.nan), min_size=1, max_size=15), max_size=3))
def test_a_cut_leaves_room_for_a_picture(rows: list[list[float]]) -> None:
    values = [np.array(row) for row in rows]
    found = cut([(np.arange(len(row), dtype=np.float64), row, row) for row in values])
    if found is not None:
        assert found.low < found.high
        assert found.least < found.low
