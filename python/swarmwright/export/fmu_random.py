"""The random number that machines and trees of modules sense, in FMUs: given by the importer, or drawn."""

from collections.abc import Sequence
from xml.etree import ElementTree as ET

from swarmwright.common.modules import is_modules
from swarmwright.export.sequences import RANDOM_SENSOR
from swarmwright.export.subject import RANDOM, Subject
from swarmwright.export.text import render

_STATE = """\
    int32_t seed;       /* 0: the master sets the random number */
    uint64_t generator; /* its state */
    int repeated;       /* successive samples with the same number of the master, counted up to CONSTANT */
    float before;       /* that random number */"""
_INTEGERS = {"2.0": "Integer", "3.0": "Int32"}


def random_sensor(subject: Subject) -> int | None:
    """Return the place of the sensor that is a random number from 0 to 1, None where there is none."""
    if subject.checks_random:
        return RANDOM_SENSOR
    if is_modules(subject.specification):  # in its simulation, the sensor is something else
        return None
    named = (place for place, one in enumerate(subject.sensors) if one.name == RANDOM and one.range is None)
    return next(named, None)


def source_parts(subject: Subject, sensors: Sequence[str], fmi: str) -> dict[str, str]:
    """Return replacements in the source of an FMU; sensors: names of its inputs."""
    place = random_sensor(subject)
    if place is None:
        nothing = dict.fromkeys(("random_state", "random_functions", "random_draw", "random_check"), "")
        return {**nothing, "integers": f"NO_VARIABLES({_INTEGERS[fmi]})"}
    values = {"random": str(place), "random_name": sensors[place]}
    return {
        "random_state": _STATE,
        "random_functions": render("fmu_random.txt", values).rstrip(),
        "random_draw": "        draw(next);",
        "random_check": "    status = check_random(instance, state, next);",
        "integers": render(f"fmu_fmi{fmi[0]}_seed.txt", values).rstrip(),
    }


def seed_words(sensor: str) -> str:
    """Return what is said of the parameter `seed`; sensor: the name of the input."""
    return (
        f"0: each step takes {sensor}; above 0: the FMU draws this number itself, from this seed, of which "
        "each robot needs another one"
    )


def add_seed(listed: ET.Element, reference: int, sensor: str, fmi: str) -> None:
    """Add the parameter `seed` to the variables; sensor: the name of the input."""
    about = {
        "name": "seed",
        "valueReference": str(reference),
        "causality": "parameter",
        "variability": "fixed",
        "description": seed_words(sensor),
    }
    value = {"min": "0", "start": "0"}
    if fmi == "3.0":
        ET.SubElement(listed, "Int32", {**about, **value})
    else:
        ET.SubElement(ET.SubElement(listed, "ScalarVariable", about), "Integer", value)
