"""Parameters of a model as parameters of its simulation: those with a value, and those that are evolved."""

from dataclasses import dataclass, field
from typing import Any, Self

from swarmwright.common.alike import alike
from swarmwright.common.untrusted import one_line
from swarmwright.interop.models._model import Model
from swarmwright.interop.models._names import Known
from swarmwright.interop.models._parts import Optimised, Problems


@dataclass
class Parameters:
    """By the name that the simulation has for each, with where it comes from."""

    fixed: dict[str, tuple[Any, str]] = field(default_factory=dict)
    evolved: dict[str, tuple[dict[str, Any], str]] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)
    """Comments on what the simulation does not have."""
    notes: list[str] = field(default_factory=list)
    agents: int = 0
    """How many agents the model has at most; 0 if it does not say."""

    @classmethod
    def of(cls, model: Model, known: Known, *, evolved: bool) -> Self:
        """Return the parameters of a model.

        evolved: whether its optimised parameters are evolved; else they keep the simulation's defaults.

        Raises InputError when an optimised parameter is none of the simulation's, two are the same one, or a
        name may stand for several.
        """
        found = cls()
        found._take_properties(model, known)
        if model.differ and known.parameters is not None:
            found._take_groups(model, known, evolved=evolved)
        else:
            found._take_members(model, known)
        if evolved:
            found._take_optimised(model, known)
        elif model.optimised:
            names = ", ".join(one.name for one in model.optimised)
            found.notes.append(f"the optimised parameters {names} are not evolved, but the controller is")
        return found

    def _take_properties(self, model: Model, known: Known) -> None:
        problems = Problems()
        named = [(one.name, one.place) for one in model.properties]
        if known.agents is None:
            named += [(one.name, one.place) for one in model.members]
        for name, place in named:
            if known.is_ambiguous(name):
                problems.add(place, known.missing(name))
        problems.stop()
        for one in model.properties:
            own = known.name(one.name)
            if own is None:
                self.left_out.append(
                    f"{one_line(one.name)} = {one_line(str(one.value))}: {known.missing(one.name)}"
                )
            else:
                self.fixed[own] = one.value, f"{one.name}, {one.place.file.name}:{one.place.line}"

    def _take_members(self, model: Model, known: Known) -> None:
        if not model.members:
            return
        self.agents = sum(member.number for member in model.members)
        counts = [(member.name, member.number, member) for member in model.members]
        place = model.members[0].place
        where = f"{' + '.join(member.name for member in model.members)}, {place.file.name}:{place.line}"
        if known.agents is not None:
            before = self.fixed.get(known.agents)
            if before is not None and before[0] != self.agents:
                self.notes.append(
                    f"{known.agents}: {before[1]} says {before[0]}, the swarm has {self.agents}, which "
                    "is taken"
                )
            self.fixed[known.agents] = self.agents, where
            if len(model.members) > 1:
                names = ", ".join(member.name for member in model.members)
                self.notes.append(
                    f"{known.simulation} has agents of one kind: {names} are {self.agents} of them"
                )
            return
        for name, number, member in counts:
            own = known.name(name)
            if own is None:
                self.left_out.append(f"{one_line(name)} = {number}: {known.missing(name)}")
            else:
                self.fixed[own] = (
                    number,
                    f"{member.launch_file or name}, {place.file.name}:{member.place.line}",
                )

    def _take_groups(self, model: Model, known: Known, *, evolved: bool) -> None:
        """Take the numbers of agents of each kind; in a team, groups state those without a parameter.

        Raises InputError when agents that steer themselves are of a kind that the simulation does not have.
        """
        problems = Problems()
        self.agents = sum(member.number for member in model.members)
        for member in model.members:
            own = known.number_of(member.name)
            if own is not None:
                where = f"{member.name}, {member.place.file.name}:{member.place.line}"
                self.fixed[own] = member.number, where
            elif evolved:
                problems.add(
                    member.place,
                    f"senses or does other things than other agents, but {known.simulation} has no parameter "
                    "with the number of agents of this kind",
                )
        problems.stop()

    def _take_optimised(self, model: Model, known: Known) -> None:
        problems = Problems()
        names = [member.name for member in model.members]
        for one in model.optimised:
            found = alike(one.name, names)
            if len(found) > 1:
                which = " or ".join(repr(names[index]) for index in found)
                problems.add(one.place, f"{one.name!r} may be the agents {which}; write one of these names")
                continue
            member = model.members[found[0]] if found else None
            name = known.name(one.name)
            if member is not None and len(model.members) == 1:
                name = known.agents or name  # the number of agents is what is optimised
            elif member is not None and model.differ:
                name = known.number_of(member.name)
            if name is None:
                problems.add(one.place, known.missing(one.name))
                continue
            if name in self.evolved:
                problems.add(one.place, f"{one.name} is the same parameter as another one, {name}")
                continue
            if member is not None and self.agents:
                self.agents += max(0, int(one.range[1]) - member.number)
            self.fixed.pop(name, None)
            self.evolved[name] = _options(one), _where(one)
        problems.stop()


def _options(one: Optimised) -> dict[str, Any]:
    return {"type": "integer" if one.whole else "real", "range": one.range}


def _where(one: Optimised) -> str:
    scaled = "" if one.scale == 1 else f", {one.low} to {one.high} times {one.scale:g}"
    return f"{one.meta}{scaled}, {one.place.file.name}:{one.place.line}"
