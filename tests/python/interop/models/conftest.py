"""A small model of Minisim, as the files of Modelio's CPSwarm modules are documented."""

from collections.abc import Callable
from pathlib import Path

import pytest

PROBLEM = """<?xml version="1.0" encoding="UTF-8"?>
<!DOCTYPE zion SYSTEM "..//IComponent.dtd">
<icomponent>
  <config>
    <entry key="classname" type="STRING" value="minisim.Minisim"/>
    <entry key="name" type="STRING" value="null"/>
  </config>
  <properties>
    <propentry key="steps" type="INT" value="25" description="Maximum number of steps."/>
    <propentry key="swarmMembers" type="INT" value="2"/>
    <propentry key="num_defenders" type="INT" value="2"/>
    <propentry key="speedDefenders" type="FLOAT" value="0.4f"/>
    <propentry key="placement" type="ENUM" value="random" enumName="helper.Placement"/>
    <propentry key="rosPath" type="STRING" value="/opt/ros"/>
  </properties>
  <requirements>
    <reqentry key="inputnumber" type="INT" value="4"/>
    <reqentry key="outputnumber" type="INT" value="1"/>
    <reqentry key="minimumCandidates" type="INT" value="1"/>
    <reqentry key="maximumCandidates" type="INT" value="null"/>
  </requirements>
</icomponent>
"""
PARAMETERS = """{"parameters": [
\t{"name": "avoidance", "meta": "file:minisim_rule", "min": 0, "max": 50, "scale": "0.1"},
\t{"name": "maxSteps", "meta": "command_line", "min": 15, "max": 30, "scale": 1}
]}
"""
SWARM = """<?xml version="1.0" encoding="UTF-8" standalone="yes"?>
<Swarm name="swarm">
    <SwarmMember name="Agent" launchFile="agent.launch" number="3"/>
</Swarm>
"""
FILES = {"problem.xml": PROBLEM, "parameters.json": PARAMETERS, "swarm.xml": SWARM}

Edited = Callable[..., Path]


@pytest.fixture
def edited(tmp_path: Path) -> Edited:
    """Writes one of the files with pieces of text replaced: `edited(name, (old, new), ..)`."""

    def make(name: str, *changes: tuple[str, str]) -> Path:
        text = FILES[name]
        for old, new in changes:
            assert old in text, old
            text = text.replace(old, new, 1)
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return make


@pytest.fixture
def drawn(edited: Edited) -> list[Path]:
    """All files, as they are."""
    return [edited(name) for name in FILES]
