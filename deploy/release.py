#!/usr/bin/env python3
"""Two steps of `make release`: check that this commit can be released, and list the files with checksums.

deploy/release.py check [--tag TAG]   refuse uncommitted changes, and versions that differ between files
deploy/release.py list FOLDER         write FOLDER/SHA256SUMS, and print names, sizes and checksums
"""

import argparse
import hashlib
import re
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
SUMS = "SHA256SUMS"
VERSIONS = {
    "CITATION.cff": r"^version: (\S+)$",
    "deploy/helm/swarmwright/Chart.yaml": r'^appVersion: "(.*)"$',
    "docs/how-to/install.md": r"^docker run --rm swarmwright:(\S+) ",
    "wrappers/cpp/CMakeLists.txt": r"^project\(swarmwright VERSION (\S+)",
    "wrappers/java/pom.xml": r"^  <version>(.*)</version>$",
}
"""Files that repeat the version of engine/Cargo.toml, and the line that has it."""


def version(root: Path) -> str:
    """Return the version that the engine, and therefore the wheel, is built with."""
    manifest = tomllib.loads((root / "engine/Cargo.toml").read_text(encoding="utf-8"))
    return str(manifest["workspace"]["package"]["version"])


def uncommitted(root: Path) -> list[str]:
    """Return a problem if the work tree differs from the commit; untracked files would be packaged."""
    command = ["git", "status", "--porcelain", "--untracked-files=all"]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        return [f"git status failed: {done.stderr.strip()}"]
    files = [line[3:] for line in done.stdout.splitlines()]
    if not files:
        return []
    more = f" and {len(files) - 5} more" if len(files) > 5 else ""
    return [f"uncommitted changes in {', '.join(files[:5])}{more}: commit or remove them"]


def different_versions(root: Path, expected: str) -> list[str]:
    """Return a problem for each file whose version is not the expected one."""
    found = {}
    for name, line in VERSIONS.items():
        match = re.search(line, (root / name).read_text(encoding="utf-8"), re.MULTILINE)
        found[name] = match[1] if match else "missing"
    lock = tomllib.loads((root / "engine/Cargo.lock").read_text(encoding="utf-8"))
    ours = [one for one in lock["package"] if one["name"].startswith("swarmwright") and "source" not in one]
    found |= {f"engine/Cargo.lock ({one['name']})": one["version"] for one in ours}
    return [
        f"{name}: the version is {other}, but {expected} in engine/Cargo.toml"
        for name, other in found.items()
        if other != expected
    ]


def missing_notes(changelog: str, expected: str) -> list[str]:
    """Return a problem unless the newest section of the changelog is that of the version, with a date."""
    sections = re.split(r"^## ", changelog, flags=re.MULTILINE)[1:]
    wanted = f"`## {expected} - YYYY-MM-DD`"
    title, _, notes = (sections or [""])[0].partition("\n")
    if title.strip("[] ") == "Unreleased":
        if notes.strip():
            return [f"CHANGELOG.md: Unreleased has entries; move them to a section {wanted}"]
        title, _, notes = (sections[1:] or [""])[0].partition("\n")
    if not re.fullmatch(rf"\[?{re.escape(expected)}\]? - \d{{4}}-\d\d-\d\d", title.strip()):
        return [f"CHANGELOG.md: the newest section after Unreleased must be {wanted}"]
    return [] if notes.strip() else [f"CHANGELOG.md: the section of {expected} is empty"]


def problems(root: Path, tag: str | None) -> list[str]:
    """Return all reasons against a release of this commit."""
    expected = version(root)
    found = uncommitted(root)
    if tag is not None and tag != f"v{expected}":
        found.append(f"the tag is {tag}, but v{expected} is the one of the version in engine/Cargo.toml")
    found += different_versions(root, expected)
    return found + missing_notes((root / "CHANGELOG.md").read_text(encoding="utf-8"), expected)


def sums(folder: Path, expected: str) -> list[tuple[str, int, str]]:
    """Write the checksums of all files of a folder, as `sha256sum --check` reads them.

    Returns:
        Name, size in bytes and SHA-256 of each file, sorted by name.

    Raises:
        ValueError: There is no wheel, or a file is not one of the expected version.
    """
    files = sorted(path for path in folder.iterdir() if path.name != SUMS)
    if not any(path.suffix == ".whl" for path in files):
        raise ValueError(f"{folder} has no wheel")
    for path in files:
        if not path.name.startswith(f"swarmwright-{expected}-"):
            raise ValueError(f"{path} is not a file of version {expected}")
    rows = []
    for path in files:
        with path.open("rb") as file:
            rows.append((path.name, path.stat().st_size, hashlib.file_digest(file, "sha256").hexdigest()))
    text = "".join(f"{digest}  {name}\n" for name, _, digest in rows)
    (folder / SUMS).write_text(text, encoding="utf-8")
    return rows


def main(arguments: list[str] | None = None, root: Path = ROOT) -> int:
    """Run a step; return the exit status."""
    parser = argparse.ArgumentParser(description="Steps of `make release`.")
    steps = parser.add_subparsers(dest="step", required=True)
    check = steps.add_parser("check", help="refuse uncommitted changes and versions that differ")
    check.add_argument("--tag", help="the tag of this commit, vVERSION")
    listing = steps.add_parser("list", help="write SHA256SUMS, and print the files")
    listing.add_argument("folder", type=Path)
    chosen = parser.parse_args(arguments)
    if chosen.step == "check":
        found = problems(root, chosen.tag)
        for problem in found:
            print(f"release: {problem}", file=sys.stderr)
        return 1 if found else 0
    try:
        rows = sums(chosen.folder, version(root))
    except (OSError, ValueError) as error:
        print(f"release: {error}", file=sys.stderr)
        return 1
    for name, size, digest in rows:
        print(f"{name}  {size / 1e6:.1f} MB  {digest}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
