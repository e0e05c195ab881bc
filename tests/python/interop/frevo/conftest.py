"""Files of FREVO's, and small ones like them."""

from collections.abc import Callable
from pathlib import Path

import pytest

STADIUM, RANDOM = "emergency_exit_stadium", "emergency_exit_random"


@pytest.fixture(scope="session")
def data(root: Path) -> Path:
    """The folder of FREVO's files."""
    return root / "tests" / "data" / "frevo"


@pytest.fixture
def edited(data: Path, tmp_path: Path) -> Callable[..., Path]:
    """Makes a copy of one of FREVO's files with pieces of text replaced: `edited(name, (old, new), ..)`."""

    def make(name: str, *changes: tuple[str, str]) -> Path:
        text = (data / name).read_text(encoding="utf-8")
        for old, new in changes:
            assert old in text, old
            text = text.replace(old, new, 1)
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return make
