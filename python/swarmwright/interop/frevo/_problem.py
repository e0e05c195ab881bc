"""FREVO's Emergency Exit: its entries as parameters of Swarmwright."""

from pathlib import Path

from swarmwright.interop.frevo._document import Session
from swarmwright.interop.frevo._field import FieldFile, find_field
from swarmwright.interop.frevo._mapped import Line, Mapped, one_line

_RANDOM_ONLY = (
    "NumberofAgents",
    "NumberofEmergencyExits",
    "NumberofBlockades",
    "NumberofEvaluations",
    "seedforEmergencyExits",
)


def problem_parameters(
    session: Session, field_file: Path | None
) -> tuple[list[Line], FieldFile | None, list[Line], list[str]]:
    """Return parameters, the field if it comes from a file, the ranking, and notes."""
    problem = session.problem
    source = problem.take_text("fieldsource", "FIELD_FROM_FILE", ("FIELD_FROM_FILE", "RANDOM_FIELD"))
    lines = [
        Line("steps", problem.take_integer("steps", 50, 1), "steps"),
        Line("stepSize", problem.take_integer("length_of_timestep_ms", 200, 0), "length_of_timestep_ms"),
    ]
    width, height = (problem.take_integer(key, 20, 1) for key in ("width", "height"))
    if source == "FIELD_FROM_FILE":
        found = find_field(problem, session.path, field_file)
        notes = []
        if (found.value["width"], found.value["height"]) != (width, height):
            notes.append(
                f"problem.width, problem.height: FREVO walls the field in at {width} x {height}; here it has "
                f"the {found.value['width']} x {found.value['height']} cells of {found.path.name}"
            )
        return lines, found, [Line("episodes", 1, "a field from a file is run once")], notes
    agents = problem.take_integer("NumberofAgents", 10, 1)
    exits = problem.take_integer("NumberofEmergencyExits", 5, 1)
    shown = {"NumberofAgents": "NumberofAgents", "NumberofEmergencyExits": "NumberofEmergencyExits"}
    # FREVO silently takes fewer; here more are refused.
    if agents > max(width, height):
        shown["NumberofAgents"] += f" = {agents}, of which FREVO takes the larger of width and height"
        agents = max(width, height)
    if exits > width * height:
        shown["NumberofEmergencyExits"] += f" = {exits}, of which FREVO takes width x height"
        exits = width * height
    lines += [
        Line("width", width, "width"),
        Line("height", height, "height"),
        Line("numAgents", agents, shown["NumberofAgents"]),
        Line("numExits", exits, shown["NumberofEmergencyExits"]),
        Line("numBlockades", problem.take_integer("NumberofBlockades", 20, 0), "NumberofBlockades"),
        Line(
            "seed", problem.take_integer("seedforEmergencyExits", 0, 0), "seedforEmergencyExits, of episode 0"
        ),
    ]
    episodes = Line("episodes", problem.take_integer("NumberofEvaluations", 10, 1), "NumberofEvaluations")
    return lines, None, [episodes, Line("aggregate", "sum", "FREVO adds them up")], []


def map_problem(session: Session, field_file: Path | None, mapped: Mapped) -> None:
    """Map every entry. Raises InputError for one that cannot be read or has no counterpart."""
    problem = session.problem
    mapped.parameters, mapped.field_file, mapped.ranking, notes = problem_parameters(session, field_file)
    mapped.notes += notes
    if mapped.field_file is None:
        mapped.not_parameters.append("fieldsource = RANDOM_FIELD: without the parameter field it is random")
        if "Filename" in problem.entries:
            unused = one_line(problem.shown("Filename"))
            mapped.not_parameters.append(f"Filename = {unused}: not used by FREVO with RANDOM_FIELD")
    else:
        mapped.not_parameters.append("fieldsource = FIELD_FROM_FILE: the parameter field says so")
        mapped.not_parameters.append("width, height: those of the field are used")
        for key in _RANDOM_ONLY:
            if key in problem.entries:
                unused = one_line(problem.shown(key))
                mapped.not_parameters.append(f"{key} = {unused}: not used by FREVO with FIELD_FROM_FILE")
