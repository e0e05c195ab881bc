"""Charts: what is drawn stands where it belongs, whatever the numbers are."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmwright.figures.chart import HEIGHT, WIDTH, Chart, Curve, _stepped, _thinned

LINE, AREA = "#0000ff", "#ff0000"


def chart(y: NDArray[np.float64], **changes: Any) -> Chart:
    spread = np.abs(y) * 0.1 + 1
    values: dict[str, Any] = {
        "title": "a title",
        "subtitle": "more of it",
        "x_name": "generation",
        "y_name": "fitness",
        "x": np.arange(len(y), dtype=np.float64),
        "curves": [
            Curve(name="area", color=AREA, y=y - spread, until=y + spread),
            Curve(name="line", color=LINE, y=y, width=6),
        ],
        "mark": (0.0, float(y[0]), "best", "#00aa00"),
    }
    return Chart(**values | changes)


def pixels(drawn: Chart) -> NDArray[np.int64]:
    picture = drawn.draw()
    assert picture.size == (WIDTH, HEIGHT)
    # The legend below is left out.
    return np.asarray(picture).astype(np.int64)[: HEIGHT - 60]


def places(found: NDArray[np.int64], color: tuple[int, int, int]) -> NDArray[np.intp]:
    """Rows and columns of pixels of a colour."""
    return np.argwhere((np.abs(found - np.array(color)) < 20).all(axis=2))


def test_a_line_that_falls_goes_from_the_upper_left_to_the_lower_right() -> None:
    found = places(pixels(chart(np.linspace(100, 0, 50))), (0, 0, 255))
    first, last = found[found[:, 1].argmin()], found[found[:, 1].argmax()]
    assert first[0] < 200
    assert last[0] > HEIGHT - 250
    assert last[1] - first[1] > 0.85 * WIDTH
    # A straight line: rows go with columns.
    assert np.corrcoef(found[:, 0], found[:, 1])[0, 1] > 0.999


def test_an_area_lets_the_grid_shine_through() -> None:
    found = pixels(chart(np.zeros(50)))
    light = places(found, (255, 214, 214))
    assert len(light) > 50_000
    inside = found[light[:, 0].min() : light[:, 0].max(), light[:, 1].min() : light[:, 1].max()]
    # Where a grid line lies below the area it is darker than the area and than the grid alone.
    assert len(places(inside, (231, 194, 197))) > 100


def test_curves_are_smooth() -> None:
    found = pixels(
        chart(np.linspace(100, 0, 50), curves=[Curve(name="", color=LINE, y=np.linspace(9, 0, 50))])
    )
    blue = found[..., 2] - found[..., 0]
    assert len(np.unique(blue)) > 8, "edges have shades"


@pytest.mark.parametrize(
    "y",
    [
        np.array([3.0]),
        np.array([0.0, 0.0]),
        np.full(10, -1e-300),
        np.array([-1e308, 1e308]),
        np.array([math.nan, 1.0, math.nan, 2.0]),
        np.full(5, math.nan),
        np.sin(np.arange(200_000.0)),
    ],
    ids=["one", "zeros", "tiny", "huge", "holes", "nothing", "many"],
)
def test_any_numbers_can_be_drawn(y: NDArray[np.float64]) -> None:
    mark = (0.0, float(np.nan_to_num(y[0])), "best", "#00aa00")
    found = pixels(chart(y, mark=mark))
    assert (found < 200).any()


def test_text_that_is_too_long_is_cut() -> None:
    # Right of the frame nothing is written.
    found = pixels(chart(np.zeros(3), title="long " * 300, subtitle="longer " * 300))
    assert (found[:80, WIDTH - 20 :] == 255).all()
    assert (found[:40, 200 : WIDTH - 60] < 100).any()


def test_steps_hold_until_the_next_point() -> None:
    corners = _stepped(np.array([[0.0, 5], [1, 5], [2, 3], [3, 3], [4, 1]]))
    assert corners.tolist() == [[0, 5], [2, 5], [2, 3], [4, 3], [4, 1]]
    assert _stepped(np.array([[0.0, 5]])).tolist() == [[0, 5]]


def test_thinning_keeps_the_extremes_of_each_column() -> None:
    generator = np.random.default_rng(1)
    points = np.stack([np.linspace(0, 99.999, 10_000), generator.uniform(0, 9, 10_000)], axis=1)
    thinned = _thinned(points, 1)
    assert len(thinned) <= 400
    for column in range(100):
        before, after = (some[np.floor(some[:, 0]) == column, 1] for some in (points, thinned))
        assert (before.min(), before.max()) == (after.min(), after.max())
    few = points[:100]
    assert _thinned(few, 1) is few or len(_thinned(few, 1)) <= 100
