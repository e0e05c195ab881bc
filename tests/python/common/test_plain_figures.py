"""Figures that do not depend on a user's settings, and letters that no font has."""

import io
import warnings

import pytest
from matplotlib.figure import Figure

from swarmwright.common import warn_once
from swarmwright.common.plain_figures import warn_of_missing_letters


def test_letters_that_no_font_has_are_named_once(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(warn_once, "_given", set())

    def drawn(text: str) -> list[str]:
        caplog.clear()
        figure = Figure()
        figure.suptitle(text)
        with warn_of_missing_letters():
            figure.savefig(io.BytesIO(), format="png")
        return [one.getMessage() for one in caplog.records]

    assert drawn("Schwärme, ñandú λ") == []
    # Tangut, which none of the fonts has that are looked for.
    (text,) = drawn("\U00017000 a \U00017001\U00017000")
    assert "has \U00017000 \U00017001, which are drawn as boxes" in text
    assert drawn("\U00017000 a \U00017001\U00017000") == []


def test_other_warnings_are_shown() -> None:
    with pytest.warns(UserWarning, match="another"), warn_of_missing_letters():
        warnings.warn("another", stacklevel=1)
