"""Collect the licence texts of the crates in engine and library for FMUs: `python engine/licenses.py FILE`.

MIT, BSD, ISC and others ask that their text, with the copyright notice, goes with binaries. Crates carry it
in their folders, which `cargo metadata` names. Crates that only build the engine, or test it, are left out.
"""
# ruff: noqa: INP001 - a program

import json
import re
import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

ENGINE = Path(__file__).parent
PROJECT = ENGINE.parent / "LICENSE"
"""The text of Apache-2.0: also for crates that may be used under it and carry none."""
ROOTS = ("swarmwright-python", "swarmwright-fmi")
_TEXT = re.compile(r"(LICEN[CS]E|COPYING|COPYRIGHT|NOTICE|UNLICENSE)([-._].*)?", re.IGNORECASE)
_RULE = "=" * 78


def metadata() -> dict[str, Any]:
    """Return what cargo knows of the crates, for the machine that this runs on."""
    said = subprocess.run(["rustc", "-vV"], capture_output=True, text=True, check=True).stdout
    (host,) = re.findall(r"^host: (.+)$", said, re.MULTILINE)
    words = ["cargo", "metadata", "--format-version", "1", "--locked", "--filter-platform", host]
    done = subprocess.run(
        [*words, "--manifest-path", str(ENGINE / "Cargo.toml")], capture_output=True, text=True, check=True
    )
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def linked(known: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the packages that are linked, sorted: the roots and what they need, without macros."""
    packages = {one["id"]: one for one in known["packages"]}
    nodes = {one["id"]: one for one in known["resolve"]["nodes"]}
    waiting = [key for key, one in packages.items() if one["name"] in ROOTS]
    seen = set(waiting)
    while waiting:
        for dependency in nodes[waiting.pop()]["deps"]:
            key = dependency["pkg"]
            is_linked = any(kind["kind"] is None for kind in dependency["dep_kinds"])
            is_macro = any("proc-macro" in target["kind"] for target in packages[key]["targets"])
            if is_linked and not is_macro and key not in seen:
                seen.add(key)
                waiting.append(key)
    return sorted((packages[key] for key in seen), key=lambda one: (one["name"], one["version"]))


def texts(package: dict[str, Any]) -> list[str]:
    """Return the licence texts in the folder of a crate, and of its parts; Apache-2.0's where that is enough.

    Raises LookupError where there is none.
    """
    folder = Path(package["manifest_path"]).parent
    files = [one for one in sorted(folder.rglob("*")) if one.is_file() and _TEXT.fullmatch(one.name)]
    if package.get("license_file"):
        files.append(folder / package["license_file"])
    files = [one for one in files if one.suffix not in (".rs", ".toml", ".py", ".sh")]
    if package["source"] is None:  # of this project
        return [PROJECT.read_text(encoding="utf-8")]
    found = [one.read_text(encoding="utf-8", errors="replace") for one in dict.fromkeys(files)]
    if found:
        return found
    choices = re.split(r"\s+OR\s+|/", package["license"] or "")
    if "Apache-2.0" in [one.strip("() ") for one in choices]:
        return [PROJECT.read_text(encoding="utf-8")]
    raise LookupError(
        f"{package['name']} {package['version']} ({package['license']}): has no licence text in {folder}"
    )


def collected(packages: list[dict[str, Any]]) -> str:
    """Return the document: which crates there are, then each text once, with the crates that it is of."""
    users: dict[str, list[str]] = defaultdict(list)
    missing = []
    for package in packages:
        name = f"{package['name']} {package['version']}"
        try:
            for text in texts(package):
                lines = [line.rstrip() for line in text.strip().splitlines()]
                users["\n".join(lines)].append(name)
        except LookupError as error:
            missing.append(str(error))
    if missing:
        raise LookupError("\n".join(missing))
    rows = [f"  {one['name']} {one['version']}: {one['license'] or 'see below'}" for one in packages]
    parts = [
        "Licences of what the engine of Swarmwright and its library for FMUs are compiled from.\n"
        "The standard library of Rust, which is linked, too, is used under Apache-2.0.\n\n" + "\n".join(rows)
    ]
    parts += [
        f"{_RULE}\nOf {', '.join(dict.fromkeys(names))}\n{_RULE}\n\n{text}" for text, names in users.items()
    ]
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    try:
        document = collected(linked(metadata()))
    except LookupError as problem:
        sys.exit(str(problem))
    Path(sys.argv[1]).write_text(document, encoding="utf-8")
