"""FMUs in C, built with the standard's headers, which FMPy has: for model exchange, and with arrays."""

import re
import subprocess
import zipfile
from pathlib import Path

import fmpy

SOURCES = Path(__file__).parents[3] / "data" / "fmu"
HEADERS = Path(fmpy.__file__).parent / "c-code"
_TYPE = re.compile(r"typedef\s+([\w ]+?\*?)\s+(fmi\d\w+)TYPE\s*\((.*?)\);", re.DOTALL)

UNITS = """
<UnitDefinitions>
  <Unit name="m"><BaseUnit m="1"/></Unit>
  <Unit name="m/s"><BaseUnit m="1" s="-1"/><DisplayUnit name="knot" factor="1.9438444924406"/></Unit>
  <Unit name="km/h"><BaseUnit m="1" s="-1" factor="0.25"/></Unit>
  <Unit name="K"><BaseUnit K="1"/><DisplayUnit name="degC" offset="-273.15"/></Unit>
</UnitDefinitions>
"""
"""A kilometre per hour has a factor here that binary numbers have."""

BALL_2 = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Ball" guid="ball" numberOfEventIndicators="1">
<ModelExchange modelIdentifier="ball"/>{UNITS}
<DefaultExperiment startTime="0" stopTime="2" tolerance="1e-6" stepSize="0.1"/>
<ModelVariables>
<ScalarVariable name="height" valueReference="0" causality="output" initial="exact">
<Real start="1" unit="m"/></ScalarVariable>
<ScalarVariable name="speed" valueReference="1" causality="output" initial="exact">
<Real start="0" unit="m/s"/></ScalarVariable>
<ScalarVariable name="push" valueReference="2" causality="input">
<Real start="0" min="0" max="20"/></ScalarVariable>
<ScalarVariable name="bounce" valueReference="3" causality="parameter" variability="fixed">
<Real start="0.7"/></ScalarVariable>
<ScalarVariable name="der(height)" valueReference="4">
<Real derivative="1"/></ScalarVariable>
<ScalarVariable name="der(speed)" valueReference="5">
<Real derivative="2"/></ScalarVariable>
</ModelVariables>
<ModelStructure><Outputs><Unknown index="1"/><Unknown index="2"/></Outputs>
<Derivatives><Unknown index="5"/><Unknown index="6"/></Derivatives></ModelStructure>
</fmiModelDescription>"""

BALL_3 = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="Ball" instantiationToken="ball">
<ModelExchange modelIdentifier="ball"/>{UNITS}
<DefaultExperiment startTime="0" stopTime="2" tolerance="1e-6" stepSize="0.1"/>
<ModelVariables>
<Float64 name="height" valueReference="0" causality="output" initial="exact" start="1" unit="m"/>
<Float64 name="speed" valueReference="1" causality="output" initial="exact" start="0" unit="m/s"/>
<Float64 name="push" valueReference="2" causality="input" start="0" min="0" max="20"/>
<Float64 name="bounce" valueReference="3" causality="parameter" variability="fixed" start="0.7"/>
<Float64 name="der(height)" valueReference="4" derivative="0"/>
<Float64 name="der(speed)" valueReference="5" derivative="1"/>
<Float64 name="time" valueReference="6" causality="independent" variability="continuous"/>
</ModelVariables>
<ModelStructure><Output valueReference="0"/><Output valueReference="1"/>
<ContinuousStateDerivative valueReference="4"/><ContinuousStateDerivative valueReference="5"/>
<EventIndicator valueReference="0"/></ModelStructure>
</fmiModelDescription>"""

ROBOTS = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="Robots" instantiationToken="robots">
<CoSimulation modelIdentifier="robots"/>
<DefaultExperiment startTime="0" stopTime="1" stepSize="0.125"/>
<ModelVariables>
<Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>
<Float64 name="place" valueReference="1" causality="output" variability="continuous">
<Dimension start="3"/><Dimension start="2"/></Float64>
<Float64 name="speed" valueReference="2" causality="input" start="0 0 0 0 0 0">
<Dimension start="3"/><Dimension start="2"/></Float64>
</ModelVariables>
<ModelStructure><Output valueReference="1"/></ModelStructure>
</fmiModelDescription>"""

MEMORY = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Memory" guid="memory" numberOfEventIndicators="0">
<ModelExchange modelIdentifier="memory"/>
<CoSimulation modelIdentifier="memory" canRunAsynchronuously="true"
 canHandleVariableCommunicationStepSize="true" canBeInstantiatedOnlyOncePerProcess="false"/>
<DefaultExperiment startTime="0" stopTime="1" tolerance="1e-6" stepSize="0.125"/>
<ModelVariables>
<ScalarVariable name="input" valueReference="0" causality="input"><Real start="0"/></ScalarVariable>
<ScalarVariable name="total" valueReference="1" causality="output" initial="exact">
<Real start="0"/></ScalarVariable>
<ScalarVariable name="sound" valueReference="2" causality="output"><Real/></ScalarVariable>
<ScalarVariable name="mode" valueReference="3" causality="parameter" variability="fixed">
<Integer start="0"/></ScalarVariable>
<ScalarVariable name="der(total)" valueReference="4"><Real derivative="2"/></ScalarVariable>
</ModelVariables>
<ModelStructure><Outputs><Unknown index="2"/><Unknown index="3"/></Outputs>
<Derivatives><Unknown index="5"/></Derivatives></ModelStructure>
</fmiModelDescription>"""

FLEET = ROBOTS.replace('<Dimension start="3"/>', '<Dimension valueReference="3"/>').replace(
    "</ModelVariables>",
    """<UInt64 name="count" valueReference="3" causality="structuralParameter" variability="fixed" start="3"/>
<Float64 name="from" valueReference="4" causality="parameter" variability="fixed"
 start="0 0.25 0.5 0.75 1 1.25"><Dimension valueReference="3"/><Dimension start="2"/></Float64>
</ModelVariables>""",
)
"""Robots whose number is a structural parameter, and where they start a parameter that is an array."""

TERMINALS = """<?xml version="1.0" encoding="UTF-8"?>
<fmiTerminalsAndIcons fmiVersion="3.0"><Terminals><Terminal name="swarm">
<TerminalMemberVariable variableName="speed" variableKind="signal"/>
<Terminal name="seen"><TerminalMemberVariable variableName="place" variableKind="signal"/></Terminal>
</Terminal></Terminals></fmiTerminalsAndIcons>"""


def build(folder: Path, name: str, description: str, terminals: str = "") -> Path:
    """Compile an FMU; functions of the standard that its source lacks do nothing."""
    three = 'fmiVersion="3.0"' in description
    version = "3" if three else "2"
    source = (SOURCES / f"{name}.c").read_text()
    written = set(re.findall(r"fmi\d\w+", re.sub(r"P\((\w+)\)", rf"fmi{version}\1", source)))
    text = (HEADERS / f"fmi{version}FunctionTypes.h").read_text()
    text = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
    missing = [
        f"{result} {function}({arguments}) {{ return {_DONE.get(result.strip(), f'fmi{version}OK')}; }}"
        for result, function, arguments in _TYPE.findall(text)
        if function not in written and "Callback" not in function
    ]
    made = folder / f"{name}{version}"
    made.mkdir(parents=True)
    (made / "all.c").write_text(f'#include "{SOURCES / name}.c"\n' + "\n".join(missing))
    define = ["-DFMI3"] if three else []
    library = made / f"{name}.so"
    words = ["gcc", "-O1", "-w", "-shared", "-fPIC", *define, f"-I{HEADERS}", "all.c", "-o", str(library)]
    subprocess.run(words, cwd=made, check=True, timeout=100)
    file = folder / f"{name.capitalize()}{version}.fmu"
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("modelDescription.xml", description)
        platform = fmpy.platform_tuple if three else fmpy.platform
        archive.write(library, f"binaries/{platform}/{library.name}")
        if terminals:
            archive.writestr("terminalsAndIcons/terminalsAndIcons.xml", terminals)
    return file


_DONE = {"void": "", "fmi2Component": "0", "fmi3Instance": "0", "const char*": '"3.0"'}
