"""Prints the oldest versions that pyproject.toml allows: python -m tests.oldest.requirements EXTRA .."""

import sys
import tomllib
from pathlib import Path

PROJECT = Path(__file__).parents[2] / "pyproject.toml"


def oldest(extras: list[str]) -> list[str]:
    """Return requirements for pip, of the package itself and of some extras.

    Raises ValueError for a library without a lower bound.
    """
    project = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]
    optional = project["optional-dependencies"]
    return [
        _pinned(one)
        for one in [*project["dependencies"], *(one for extra in extras for one in optional[extra])]
    ]


def _pinned(requirement: str) -> str:
    name, bound, versions = requirement.partition(">=")
    if not bound:
        raise ValueError(f"{PROJECT.name}: {requirement}: has no lower bound")
    return f"{name}=={versions.partition(',')[0]}"


if __name__ == "__main__":
    print("\n".join(oldest(sys.argv[1:])))
