from itertools import combinations
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

from swarmwright import InputError, compare
from swarmwright.display.figures.run import draw
from swarmwright.display.figures.style import STYLES, Page, draw_title, new_figure, save, style_axes, use_page
from swarmwright.runs.diversity import diversity
from tests.python.analysis.runs import KnownRun


def test_a_title_without_blanks_is_not_left_out() -> None:
    figure = new_figure(7.6, 6.0)
    draw_title(figure, "a_simulation_without_blanks_" * 5)
    title = figure.get_suptitle()
    assert title.startswith("a_simulation_without_blanks_a_sim")
    assert title.endswith("…")
    figure.draw_without_rendering()
    (text,) = figure.texts
    assert text.get_window_extent().x1 <= figure.bbox.x1


@pytest.mark.slow
@pytest.mark.parametrize("by", ["save", "savefig"])
def test_fonts_are_embedded_as_publishers_take_them(tmp_path: Path, by: str) -> None:
    """Not as Type 3, which the submission systems of IEEE and others refuse."""
    figure = new_figure(4.0, 3.0)
    draw_title(figure, "a title, −1 µm")
    figure.subplots().set_ylabel("$x^2$")
    file = tmp_path / "figure.pdf"
    if by == "save":
        save(figure, file)
    else:
        figure.savefig(file)
    content = file.read_bytes()
    assert b"/Type3" not in content
    assert b"/FontFile2" in content
    eps = tmp_path / "figure.eps"
    figure.savefig(eps)
    assert b"/FontType 42" in eps.read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("width", ["column", "page"])
def test_figures_fit_the_columns_of_publishers(tmp_path: Path, style: str, width: str) -> None:
    """Nothing is cut off or overlaps, and no text is larger or much smaller than asked for."""
    if STYLES[style].column is None:
        return
    made = [
        KnownRun(tmp_path / f"{size}-{seed}", [[seed, 0.0], [size + seed, 1.0]] * 5, seed=seed, method=method)
        for size in (4, 6)
        for method in ({"population": size},)
        for seed in range(5)
    ]
    asked: dict[str, Any] = {"style": style, "width": width}
    for figure in (compare(made).figure(**asked), drawn(made[0], asked)):
        inches = STYLES[style].column if width == "column" else STYLES[style].page
        assert figure.get_figwidth() == inches
        figure.draw_without_rendering()
        ticks = [  # also those outside of an axis, which are not drawn
            label
            for axes in figure.axes
            for axis in (axes.xaxis, axes.yaxis)
            for label in axis.get_ticklabels(which="both")
        ]
        texts = [one for one in figure.findobj(Text) if one.get_text() and one not in ticks]
        for text in texts:
            assert 0.8 * STYLES[style].points <= float(text.get_fontsize()) <= 1.1 * STYLES[style].points
            box = text.get_window_extent()
            assert box.x0 > -2, text
            assert box.x1 < figure.bbox.x1 + 2, text
            assert box.y0 > -2, text
            assert box.y1 < figure.bbox.y1 + 2, text
        assert figure.get_suptitle() == ""
        labels = [axes.yaxis.label.get_window_extent() for axes in figure.axes]
        assert not any(one.overlaps(other) for one, other in combinations(labels, 2))
        for axes in figure.axes:
            assert axes.get_window_extent().width > figure.bbox.width / 5
            assert axes.get_window_extent().height > figure.bbox.height / 10


def drawn(run: KnownRun, asked: dict[str, Any]) -> Figure:
    with use_page(Page.from_options(**asked)):
        return draw(run, diversity(run))


def test_lengths_are_read_with_their_units() -> None:
    for width, inches in (
        ("89 mm", 3.504), ("8.9cm", 3.504), ("252pt", 3.487), ("3.5in", 3.5), ("3.5", 3.5), (3.5, 3.5),
    ):  # fmt: skip
        assert Page.from_options("nature", width).width == pytest.approx(inches, abs=1e-3)
    assert Page.from_options("screen").width is None
    with pytest.raises(InputError, match=r"^style: must be one of screen, ieee, .*, not 'iee'$"):
        Page.from_options("iee")


def test_labels_are_plain_text() -> None:
    figure = new_figure(4.0, 3.0)
    axes = figure.subplots()
    style_axes(axes, x="costs $5", y="unit (\\frac{$)")
    figure.draw_without_rendering()
    assert axes.get_ylabel() == "unit (\\frac{$)"
