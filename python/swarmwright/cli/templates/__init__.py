"""Commented experiment files to start from, one file for each."""

import re
from importlib.resources import files
from typing import TYPE_CHECKING

from swarmwright import _engine
from swarmwright.common.arguments import check_arguments
from swarmwright.common.errors import InputError
from swarmwright.common.simulation_names import MISSIONS, SIMULATORS
from swarmwright.common.suggestions import unknown

if TYPE_CHECKING:
    from swarmwright.common.engine_types import Mission


def names() -> list[str]:
    """Return the names of all templates, sorted."""
    return sorted(
        entry.name.removesuffix(".yaml")
        for entry in files(__name__).iterdir()
        if entry.name.endswith(".yaml")
    )


def simulators() -> list[str]:
    """Return the titles of other simulators that `arena` knows: their servers offer the arena's missions."""
    return [title for title in SIMULATORS if title.startswith(MISSIONS)]


@check_arguments
def text(name: str) -> str:
    """Return the experiment file of a template, or of one of `simulators`.

    Raises InputError for an unknown one.
    """
    if name in simulators():
        return arena(simulation=name)
    if name not in names():
        raise InputError(unknown("template", name, [*names(), *simulators()]))
    return files(__name__).joinpath(f"{name}.yaml").read_text(encoding="utf-8")


def minisim() -> str:
    """Return the published Minisim example: one agent has to pass one defender and reach the goal."""
    return text("minisim")


def emergency_exit() -> str:
    """Return Emergency Exit on ten of FREVO's random fields: ten agents, five exits, twenty blockades."""
    return text("emergency_exit")


@check_arguments
def arena(mission: str = "aggregation", simulation: str = "arena") -> str:
    """Return an experiment with a mission of the arena.

    mission: by default aggregation with ambient cues: e-pucks gather on a black spot.
    simulation: `arena`, or one of `simulators`, whose servers are on a broker.
    Raises InputError for an unknown one of them.
    """
    titles = ["arena", *simulators()]
    if simulation not in titles:
        raise InputError(unknown("simulation", simulation, titles))
    file = _with_mission(text("arena"), mission)
    return file if simulation == "arena" else _on_servers(file, simulation)


def _on_servers(file: str, simulation: str) -> str:
    """Return the experiment with the simulation of servers."""
    lines = (
        f"simulation: {simulation:<21} # servers of this simulator offer it: {SIMULATORS[simulation]}\n"
        "broker: mqtt://localhost:1883     # to which these servers are connected"
    )
    file, count = re.subn(r"^simulation: arena .*$", lines, file, count=1, flags=re.MULTILINE)
    assert count == 1
    return file


def _with_mission(file: str, mission: str) -> str:
    """Return the experiment with another mission. Raises InputError for an unknown one."""
    chosen = _mission(mission)
    if chosen["name"] == "aac":
        return file
    title, duration = chosen["title"].lower(), f"{chosen['duration']:g}"
    own = re.search(r"^robots?:\s*$", chosen["text"], flags=re.MULTILINE) is not None
    kinds = re.findall(r"^  - name: (.+)$", chosen["text"], flags=re.MULTILINE)
    robots = "robots that the mission describes" if own else "e-pucks (reference model RM1.1)"
    of_each = "a weight from each input to each actuator" if own else "24 inputs, 2 wheels, 50 weights"
    controller = f"  kind: evostick                  # {of_each}; or layered, fully_meshed"
    section = r"  kind: evostick +# 24 .*"
    if kinds and re.search(r"^sides:\s*$", chosen["text"], flags=re.MULTILINE):
        section = rf"controller:.*\n{section}"
        controller = "populations:                      # each plays a side of the matches" + "".join(
            f"\n  {kind}: {{controller: {{kind: evostick}}}}{'':<{10 - len(kind)}} # {of_each}"
            for kind in kinds
        )
    elif kinds:
        controller = "  kind: team                      # a controller for each kind of robots\n  groups:"
        controller += "".join(
            f"\n    {kind}: {{kind: evostick}}{'':<{12 - len(kind)}}# {of_each}" for kind in kinds
        )
    for pattern, line in (
        (r"# Arena: .*", f"# Arena: {title}, by a swarm of {robots}."),
        (section, controller),
        (r"  mission: .*", f"  mission: {mission:<22} # or the path of a YAML file with a custom mission"),
        (r"  robots: .*", f"  robots: {chosen['robots']:<23} # 1 to 100,000"),
        (r"  duration: .*", f"  duration: {duration:<21} # seconds"),
    ):
        file, count = re.subn(f"^{pattern}$", line, file, count=1, flags=re.MULTILINE)
        assert count == 1, pattern
    if section.startswith("controller"):
        tournament = (
            "  kind: tournament\n  pairing: hall_of_fame           # champions of earlier generations"
        )
        file, count = re.subn(r"^  kind: absolute\n", f"{tournament}\n", file, count=1, flags=re.MULTILINE)
        assert count == 1
        file = re.sub(r"^  aggregate: .*\n", "", file, flags=re.MULTILINE)
    # The numbers of robots of several kinds are those of the mission.
    return re.sub(r"^  robots: .*\n", "", file, flags=re.MULTILINE) if kinds else file


def missions() -> list[str]:
    """Return the names of the arena's missions, sorted; of those with two names the longer one."""
    return sorted(mission["also"] or mission["name"] for mission in _engine.missions())


@check_arguments
def mission(name: str) -> str:
    """Return the YAML file of a mission of the arena, by either of its names.

    Raises InputError for an unknown one.
    """
    return _mission(name)["text"]


def _mission(name: str) -> "Mission":
    all_missions = _engine.missions()
    for entry in all_missions:
        if name in (entry["name"], entry["also"]):
            return entry
    names = [name for entry in all_missions for name in (entry["name"], entry["also"]) if name]
    hint = ""
    if name.endswith((".yaml", ".yml")):
        hint = f"; to use a mission file, name it in the experiment: parameters: {{mission: {name}}}"
    raise InputError(f"{unknown('mission', name, names)}{hint}")
