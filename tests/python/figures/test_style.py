from pathlib import Path

import pytest

from swarmwright.figures.style import entitle, new_figure, save


def test_a_title_without_blanks_is_not_left_out() -> None:
    figure = new_figure(7.6, 6.0)
    entitle(figure, "a_simulation_without_blanks_" * 5)
    title = figure.get_suptitle()
    assert title.startswith("a_simulation_without_blanks_a_sim")
    assert title.endswith("…")
    figure.draw_without_rendering()
    (text,) = figure.texts
    assert text.get_window_extent().x1 <= figure.bbox.x1


@pytest.mark.parametrize("by", ["save", "savefig"])
def test_fonts_are_embedded_as_publishers_take_them(tmp_path: Path, by: str) -> None:
    """Not as Type 3, which the submission systems of IEEE and others refuse."""
    figure = new_figure(4.0, 3.0)
    entitle(figure, "a title, −1 µm")
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
