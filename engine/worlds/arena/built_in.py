"""Write the built-in missions and robots as JSON, which the engine reads: `make reference` calls it.

They are edited as YAML, which people start their own from. The engine has no reader of YAML for these files
alone: it took 31 s of processor time to compile.
"""
# ruff: noqa: INP001 - a program

import json
from pathlib import Path

from ruamel.yaml import YAML

SOURCES = Path(__file__).parent / "src"


def written(folder: Path) -> str:
    """Return the files of a folder as one JSON object, a line for each, by their names without `.yaml`."""
    yaml = YAML(typ="safe", pure=True)
    lines = (
        f"{json.dumps(path.stem)}: {json.dumps(yaml.load(path), allow_nan=False)}"
        for path in sorted(folder.glob("*.yaml"))
    )
    return "{\n" + ",\n".join(lines) + "\n}\n"


if __name__ == "__main__":
    for name in ("missions", "robots"):
        file, text = SOURCES / f"{name}.json", written(SOURCES / name)
        if file.read_text() != text:  # else nothing is to be compiled
            file.write_text(text)
