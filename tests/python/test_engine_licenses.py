"""The licence texts of the crates that are linked, as wheels and FMUs hold them."""

import importlib.util
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

FILE = Path(__file__).parents[2] / "engine" / "licenses.py"


@pytest.fixture(scope="module")
def licenses() -> ModuleType:
    spec = importlib.util.spec_from_file_location("engine_licenses", FILE)
    assert spec is not None
    assert spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


def crate(folder: Path, name: str, files: dict[str, str], **about: Any) -> dict[str, Any]:
    (folder / name).mkdir()
    for file, text in files.items():
        (folder / name / file).write_text(text)
    known: dict[str, Any] = {"license": "MIT", "license_file": None, "source": "registry", "version": "1.0.0"}
    known |= {"id": name, "name": name, "targets": [{"kind": ["lib"]}]}
    return {**known, "manifest_path": str(folder / name / "Cargo.toml"), **about}


def test_what_is_linked(licenses: ModuleType, tmp_path: Path) -> None:
    names = ("swarmwright-fmi", "linked", "deeper", "built", "tested")
    packages = [crate(tmp_path, name, {}) for name in names]
    packages.append(crate(tmp_path, "macro", {}, targets=[{"kind": ["proc-macro"]}]))
    needs: dict[str, dict[str, str | None]] = {
        "swarmwright-fmi": {"linked": None, "built": "build", "tested": "dev", "macro": None},
        "linked": {"deeper": None},
        "macro": {"built": None},
    }
    nodes = [
        {
            "id": one["id"],
            "deps": [
                {"pkg": name, "dep_kinds": [{"kind": kind}]}
                for name, kind in needs.get(one["id"], {}).items()
            ],
        }
        for one in packages
    ]
    found = licenses.linked({"packages": packages, "resolve": {"nodes": nodes}})
    assert [one["name"] for one in found] == ["deeper", "linked", "swarmwright-fmi"]


def test_each_text_is_there_once(licenses: ModuleType, tmp_path: Path) -> None:
    first = crate(tmp_path, "first", {"LICENSE-MIT": "Copyright A\nfree\n", "license.rs": "fn main"})
    second = crate(tmp_path, "second", {"COPYING": "Copyright A\nfree"})
    third = crate(tmp_path, "third", {"terms.txt": "Copyright C"}, license=None, license_file="terms.txt")
    apache = crate(tmp_path, "apache", {}, license="MIT OR Apache-2.0")
    text = licenses.collected([first, second, third, apache])
    assert text.count("Copyright A\nfree") == 1
    assert "Of first 1.0.0, second 1.0.0\n" in text
    assert "  third 1.0.0: see below\n" in text
    assert "Copyright C" in text
    assert "Apache License" in text
    assert "fn main" not in text


def test_a_missing_text_is_an_error(licenses: ModuleType, tmp_path: Path) -> None:
    bare = [crate(tmp_path, name, {"README.md": "MIT"}) for name in ("one", "two")]
    with pytest.raises(LookupError, match=r"(?s)one 1\.0\.0 \(MIT\): has no licence text in .*two 1\.0\.0"):
        licenses.collected(bare)
