"""The check of the engine's dependencies finds what deny.toml forbids."""

import importlib.util
from pathlib import Path
from typing import Any

import pytest

FILE = Path(__file__).parents[2] / "engine" / "dependencies.py"
RULES: dict[str, Any] = {
    "licenses": {"allow": ["MIT", "Apache-2.0", "ISC", "Apache-2.0 WITH LLVM-exception"]},
    "sources": {"allow-registry": ["https://registry"]},
    "bans": {
        "deny": [{"crate": "openssl", "reason": "rustls"}, {"crate": "ring", "deny-multiple-versions": True}]
    },
}


@pytest.fixture(scope="module")
def check() -> Any:
    spec = importlib.util.spec_from_file_location("dependencies", FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("expression", "fits"),
    [
        ("MIT", True),
        ("GPL-3.0", False),
        ("", False),
        ("MIT/Apache-2.0", True),
        ("GPL-3.0 OR MIT", True),
        ("GPL-3.0 AND MIT", False),
        ("ISC AND (GPL-3.0 OR Apache-2.0)", True),
        ("(MIT OR ISC) AND Unicode-3.0", False),
        ("GPL-3.0 AND MIT OR ISC", True),
        ("Apache-2.0 WITH LLVM-exception", True),
        ("MIT WITH LLVM-exception", False),
        ("(MIT", False),
        ("MIT ISC", False),
    ],
)
def test_licences(check: Any, expression: str, fits: bool) -> None:
    assert check.permitted(expression, set(RULES["licenses"]["allow"])) is fits


def package(name: str, version: str = "1.0.0", **other: Any) -> dict[str, Any]:
    return {
        "name": name,
        "version": version,
        "license": "MIT",
        "source": "registry+https://registry",
        **other,
    }


def test_what_breaks_a_rule_is_named(check: Any) -> None:
    good = [package("a"), package("own", source=None), package("b"), package("b", "2.0.0"), package("ring")]
    assert list(check.problems(good, RULES)) == []
    bad = {
        "c 1.0.0: the licence None": package("c", license=None),
        "d 1.0.0: comes from git+https://somewhere": package("d", source="git+https://somewhere"),
        "openssl 1.0.0: deny.toml forbids it (rustls)": package("openssl"),
        "ring: comes in the versions 1.0.0, 2.0.0": package("ring", "2.0.0"),
    }
    found = list(check.problems([*good, *bad.values()], RULES))
    assert len(found) == len(bad)
    for start in bad:
        assert any(line.startswith(start) for line in found), start
