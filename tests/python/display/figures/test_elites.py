import numpy as np

from swarmwright.display.figures.elites import draw_archive, draw_front


def test_numbers_beside_colours_are_whole() -> None:
    """Not differences from another number."""
    near = 1000 - np.arange(1.0, 5.0) * 1e-9
    cells = draw_archive(near.reshape(2, 2), ["a", "b"], [(0, 1), (0, 1)], (4, 4), "title")
    values = np.column_stack([near, near, near])
    points = draw_front(values, ["a", "b"], ["maximize", "maximize"], "title")
    for figure in (cells, points):
        figure.draw_without_rendering()
        assert [axes.yaxis.get_offset_text().get_text() for axes in figure.axes] == ["", ""]
        labels = [label.get_text() for label in figure.axes[1].get_yticklabels()]
        assert len(set(labels)) == len(labels)
        assert all(text.startswith(("999.9999999", "1000")) for text in labels)
