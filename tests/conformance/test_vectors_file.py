"""The golden vectors of controllers are in the repository once, and in the package that is installed."""

import subprocess
import sys
import tarfile
from pathlib import Path

from swarmwright.conformance.server.vectors import FILE
from tests.conftest import ROOT

VECTORS = ROOT / "protocol" / "vectors" / "controllers.json"


def test_the_file_of_the_package_is_a_link_to_the_vectors() -> None:
    assert FILE.is_symlink()
    assert FILE.resolve() == VECTORS


def test_the_source_distribution_holds_a_copy(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "maturin", "sdist", "--out", str(tmp_path)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (file,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(file) as archive:
        name = f"{archive.getnames()[0].split('/')[0]}/python/swarmwright/conformance/server/controllers.json"
        assert archive.getmember(name).isreg()
        content = archive.extractfile(name)
        assert content is not None
        assert content.read() == VECTORS.read_bytes()
