"""Installing brokers with the package registries' own clients, and asking which release is installed."""

import json
import os
import re
import subprocess
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import cast

POM = """\
<project xmlns="http://maven.apache.org/POM/4.0.0">
  <modelVersion>4.0.0</modelVersion>
  <groupId>brokers</groupId><artifactId>brokers</artifactId><version>1</version><packaging>pom</packaging>
  <dependencies>
{dependencies}  </dependencies>
</project>
"""
DEPENDENCY = """\
    <dependency>
      <groupId>{group}</groupId><artifactId>{artifact}</artifactId><version>{version}</version>
    </dependency>
"""


def run(*command: str, env: Mapping[str, str] | None = None, cwd: Path | None = None) -> str:
    """What it prints; a RuntimeError with the end of its message if it fails."""
    done = subprocess.run(
        command,
        env={**os.environ, **(env or {})},
        cwd=cwd,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=1800,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"{command[0]}: {(done.stderr or done.stdout)[-500:]}")
    return done.stdout


def npm_release(package: str) -> Callable[[Path], str]:
    """As its package.json says."""

    def release(home: Path) -> str:
        text = (home / "node_modules" / package / "package.json").read_text(encoding="utf-8")
        return cast("str", json.loads(text)["version"])

    return release


def pip_release(package: str) -> Callable[[Path], str]:
    """As pip in the virtual environment `home` says."""

    def release(home: Path) -> str:
        said = run(str(home / "bin" / "python"), "-m", "pip", "show", package)
        return said.partition("Version: ")[2].split("\n")[0]

    return release


def go_release(binary: str) -> Callable[[Path], str]:
    """As the build information in the program says."""

    def release(home: Path) -> str:
        said = run("go", "version", "-m", str(home / binary))
        return said.partition("\n\tmod\t")[2].split("\t")[1].removeprefix("v")

    return release


def install_jars(group: str, version: str, *artifacts: str) -> Callable[[Path], None]:
    """These artifacts of Maven Central and what they need, in `home`/jars."""

    def install(home: Path) -> None:
        done = home / f".{artifacts[0]}-{version}"
        if not done.exists():
            needed = (DEPENDENCY.format(group=group, artifact=each, version=version) for each in artifacts)
            (home / "pom.xml").write_text(POM.format(dependencies="".join(needed)))
            copy = ("dependency:copy-dependencies", f"-DoutputDirectory={home / 'jars'}")
            run("mvn", "-q", "-B", "-f", str(home / "pom.xml"), *copy)
            done.touch()

    return install


def jar_release(artifact: str) -> Callable[[Path], str]:
    """As the name of its archive says."""

    def release(home: Path) -> str:
        found = [re.fullmatch(rf"{artifact}-(\d.*)\.jar", jar.name) for jar in (home / "jars").iterdir()]
        return next((match[1] for match in found if match), "unknown")

    return release
