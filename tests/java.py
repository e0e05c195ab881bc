"""The Java wrapper: its jar, built where it is missing or older than its sources, and the server in it."""

import os
import shutil
import subprocess
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from tests.conftest import ROOT
from tests.system.processes import Program

PROJECT = ROOT / "wrappers" / "java"
JAR = PROJECT / "target" / "minisim.jar"


def _sources() -> list[Path]:
    return [
        PROJECT / "pom.xml",
        *(PROJECT / "src" / "main").rglob("*.java"),
        *(ROOT / "protocol" / "schemas").glob("*.json"),
    ]


@cache
def jar() -> Path:
    """The jar with the example server, the library and all that they need."""
    newest = max(path.stat().st_mtime for path in _sources())
    if not JAR.exists() or JAR.stat().st_mtime < newest:
        maven = shutil.which("mvn")
        assert maven, "Maven is missing; `make test-peers` installs it"
        command = [maven, "-q", "-B", "-DskipTests", "-f", str(PROJECT / "pom.xml"), "package"]
        built = subprocess.run(command, capture_output=True, text=True, timeout=500, check=False)
        assert built.returncode == 0, built.stdout + built.stderr
    return JAR


class JavaServer(Program):
    """`java -cp CLASSPATH MAIN OPTIONS`, the example server when not told otherwise; ready once made.

    url: of the broker; None to leave it to the environment.
    """

    def __init__(
        self,
        url: str | None,
        *options: str,
        cwd: Path,
        server: int = 1,
        main: str | None = None,
        classpath: str = "",
        env: Mapping[str, str] | None = None,
    ) -> None:
        java = shutil.which("java")
        assert java, "Java is missing; `make test-peers` installs it"
        library = os.pathsep.join(filter(None, [str(jar()), classpath]))
        where = () if url is None else ("--broker", url)
        command = [java, "-Xshare:auto", "-cp", library, main or "org.swarmwright.minisim.Main"]
        super().__init__(*command, *where, "--id", server, *options, cwd=cwd, env=env, program=())
        try:
            self.until_error("ready")
        except BaseException:
            self.stop()
            raise
