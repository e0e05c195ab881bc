"""Checks the files of a configuration: SUMO itself ends the process at a network that is not XML."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

from swarmwright.common.errors import InputError
from swarmwright.common.temporary import TemporaryFolder

_INPUTS = ("net-file", "route-files", "additional-files")
_SHORT = {"n": "net-file", "net": "net-file", "r": "route-files", "a": "additional-files", "l": "log"}
_OUTPUT = re.compile(
    r".*-output|.*\.output|netstate-dump|log|message-log|error-log|pedestrian\.jupedsim\.(?:wkt|py)|save-.*"
)
"""Options that name files to be written, or times at which files are written."""
_OUTPUT_OF_A_DEVICE = re.compile(r"device\.(?:ssm|toc)\.file")
_SWITCHED_OFF = {
    "random": ("false", ("", "0", "false", "no", "off", "f", "n", "-")),
    "remote-port": ("0", ("", "0")),
    "gui-settings-file": ("", ("",)),
}
"""Options that take away repeatability or lock-step: what they are set to, and values that change nothing."""
_NOWHERE = "NUL"
"""What SUMO, on every system, calls a file that keeps nothing."""
_UP = "../" * 64
"""To the root of the file system, from any folder."""


@dataclass(frozen=True)
class Configuration:
    """A configuration of SUMO whose files can be read."""

    path: Path
    options: tuple[str, ...]
    """What SUMO gets beside it, so that episodes are repeatable, isolated and in lock-step."""
    overridden: tuple[str, ...]
    """The options and the elements of additional files that therefore have no effect."""

    @property
    def notice(self) -> str | None:
        """What the user is told of them; None where there are none."""
        if not self.overridden:
            return None
        return (
            f"config: {self.path}: without effect here: {', '.join(self.overridden)}; episodes follow from "
            "their seed alone, in lock-step, and SUMO writes no files"
        )


def checked(config: str) -> Configuration:
    """Return a configuration whose network, routes and additional files can be read.

    Raises InputError, "config: why".
    """
    if not config:
        raise InputError(
            "config: missing; expected the path of a configuration of SUMO, such as town.sumocfg"
        )
    path = Path(config).absolute()
    given = {
        _SHORT.get(one.tag, one.tag): one.get("value") or one.get("v") or "" for one in _parse(path).iter()
    }
    if "net-file" not in given:
        raise InputError(f"config: {path}: it names no net-file")
    overridden, options = [], []
    for name, (value, harmless) in _SWITCHED_OFF.items():
        options += [f"--{name}", value]
        if given.get(name, "").strip().lower() not in harmless:
            overridden.append(name)
    for name, value in given.items():
        if value and _OUTPUT.fullmatch(name) and _names_a_file(name):
            options += [f"--{name}", "" if name.startswith("save-") else _NOWHERE]
            overridden.append(name)
        elif value and _OUTPUT_OF_A_DEVICE.fullmatch(name):
            overridden.append(name)
    for name in _INPUTS:
        for file in given.get(name, "").replace(",", " ").split():
            root = _parse(path.parent / file)
            if name == "additional-files":
                overridden += _detectors(root)
    return Configuration(path, tuple(options), tuple(dict.fromkeys(overridden)))


def _names_a_file(name: str) -> bool:
    """Return whether an option that is called as outputs are is one, rather than a detail of another."""
    return not name.startswith("save-") or name in {
        "save-state.times", "save-state.files", "save-configuration", "save-template", "save-schema",
    }  # fmt: skip


def _detectors(root: ET.Element) -> Iterator[str]:
    """Yield the elements of additional files that write files of their own."""
    for one in root.iter():
        written = one.get("file") if one.tag not in _READ else None
        if (written or one.get("dest")) not in {None, "", _NOWHERE, "/dev/null"}:
            yield f"{one.tag} {one.get('id', '')}".strip()


_READ = frozenset({"variableSpeedSign", "calibrator", "include", "rerouter", "poi", "poly"})
"""Elements whose `file` is read."""


class Outputs:
    """A private folder for what SUMO writes nevertheless: detectors and devices with files of their own."""

    def __init__(self) -> None:
        self._folder = TemporaryFolder("sumo")
        folder = str(self._folder.path)
        # SUMO puts the prefix between the folder and the name of each file that it writes.
        self.options = ("--output-prefix", f"{_UP}{folder.lstrip('/')}/")


def _parse(path: Path) -> ET.Element:
    """Return the root of an XML file; an empty one where it is compressed, which SUMO reads, too."""
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"config: {path}: is not a file")
        with path.open("rb") as file:
            if file.read(2) == b"\x1f\x8b":
                return ET.Element("compressed")
            file.seek(0)
            return ET.parse(file).getroot()  # noqa: S314 - the user has SUMO read it, too
    except OSError as error:
        raise InputError(f"config: {path}: {error.strerror}") from None
    except ValueError:  # no path at all
        raise InputError(f"config: {str(path)!r}: is not a path") from None
    except ET.ParseError as error:
        raise InputError(f"config: {path}: not valid XML: {error}") from None
