"""Options that methods must have in experiments."""

from typing import Any

NEEDED: dict[str, dict[str, Any]] = {
    "map_elites": {"measures": {"steps": {"range": [0, 50], "bins": 10}}},
    "novelty": {"measures": {"steps": {"range": [0, 50], "bins": 10}}},
    "nsga2": {"objectives": {"steps": "minimize"}},
    "nsga3": {"objectives": {"steps": "minimize"}},
}
"""For Minisim, by kind of method."""


def method_of(kind: str, **options: Any) -> dict[str, Any]:
    """The section `method` of an experiment."""
    return {"kind": kind, **NEEDED.get(kind, {}), **options}
