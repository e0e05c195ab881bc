"""FMUs that pythonfmu has built."""

from pathlib import Path

import pytest
from pythonfmu.builder import FmuBuilder

SOURCES = Path(__file__).parents[3] / "data" / "fmu"


@pytest.fixture(scope="session")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with Vehicle.fmu and Pair.fmu."""
    folder = tmp_path_factory.mktemp("fmus")
    for name in ("vehicle", "pair"):
        FmuBuilder.build_FMU(SOURCES / f"{name}.py", dest=folder)
    return folder
