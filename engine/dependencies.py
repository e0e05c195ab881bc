"""Checks the engine's dependencies against deny.toml without a database: licences, sources, bans.

`cargo deny check` (`make audit`) does the same and looks for known vulnerabilities, which needs one.
"""

import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent


def permitted(expression: str, allowed: set[str]) -> bool:
    """Whether an SPDX expression can be fulfilled with the allowed licences.

    Of `OR` (crates of old write `/`) one side is enough, of `AND` both are needed; parentheses bind.
    """
    tokens = re.findall(r"[()]|[^\s()]+", expression.replace("/", " OR "))

    def either() -> bool:
        found = both()
        while tokens and tokens[0] == "OR":
            tokens.pop(0)
            found = both() or found
        return found

    def both() -> bool:
        found = one()
        while tokens and tokens[0] == "AND":
            tokens.pop(0)
            found = one() and found
        return found

    def one() -> bool:
        word = tokens.pop(0) if tokens else ""
        if word == "(":
            found = either()
            return bool(tokens) and tokens.pop(0) == ")" and found
        if tokens[:1] == ["WITH"]:
            word = " ".join([word, *tokens[:2]])
            del tokens[:2]
        return word in allowed

    return either() and not tokens


def problems(packages: list[dict[str, Any]], rules: dict[str, Any]) -> Iterator[str]:
    """A line for each package of `cargo metadata` that breaks a rule."""
    allowed = set(rules["licenses"]["allow"])
    sources = {f"registry+{registry}" for registry in rules["sources"]["allow-registry"]}
    bans = {ban["crate"]: ban for ban in rules["bans"]["deny"]}
    versions: dict[str, set[str]] = {}
    for package in packages:
        name, version = package["name"], package["version"]
        versions.setdefault(name, set()).add(version)
        if not permitted(package["license"] or "", allowed):
            yield f"{name} {version}: the licence {package['license']!r} is not among those of deny.toml"
        if package["source"] is not None and package["source"] not in sources:
            yield f"{name} {version}: comes from {package['source']}, which deny.toml does not allow"
        if "reason" in bans.get(name, {}):
            yield f"{name} {version}: deny.toml forbids it ({bans[name]['reason']})"
    for name, found in versions.items():
        if bans.get(name, {}).get("deny-multiple-versions") and len(found) > 1:
            yield f"{name}: comes in the versions {', '.join(sorted(found))}; deny.toml wants one"


def main() -> int:
    """Check the locked dependencies; the exit status."""
    command = ["cargo", "metadata", "--format-version=1", "--locked"]
    shown = subprocess.run(command, cwd=HERE, check=True, stdout=subprocess.PIPE, text=True).stdout
    rules = tomllib.loads((HERE / "deny.toml").read_text(encoding="utf-8"))
    packages = json.loads(shown)["packages"]
    found = list(problems(packages, rules))
    for line in found:
        print(line, file=sys.stderr)
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
