"""The checks before commits and pushes are those of `.ci/run`, and need nothing from the network."""

import re
from pathlib import Path

from ruamel.yaml import YAML

ROOT = Path(__file__).parents[2]


def hooks() -> list[dict[str, str]]:
    configuration = YAML(typ="safe").load(ROOT / ".pre-commit-config.yaml")
    assert [repository["repo"] for repository in configuration["repos"]] == ["local"]
    found: list[dict[str, str]] = configuration["repos"][0]["hooks"]
    return found


def test_every_check_of_the_ci_has_a_hook() -> None:
    checks = set(re.findall(r"\b(?:lint|check)-\w+", (ROOT / ".ci" / "run").read_text(encoding="utf-8")))
    assert len(checks) >= 6
    assert checks == {hook["entry"].removeprefix("make ") for hook in hooks() if "make " in hook["entry"]}


def test_hooks_install_nothing() -> None:
    assert {hook["language"] for hook in hooks()} == {"system"}
