from swarmwright.figures.style import entitle, new_figure


def test_a_title_without_blanks_is_not_left_out() -> None:
    figure = new_figure(7.6, 6.0)
    entitle(figure, "a_simulation_without_blanks_" * 5)
    title = figure.get_suptitle()
    assert title.startswith("a_simulation_without_blanks_a_sim")
    assert title.endswith("…")
    figure.draw_without_rendering()
    (text,) = figure.texts
    assert text.get_window_extent().x1 <= figure.bbox.x1
