"""Why a run cannot continue whose generations come out differently when it is resumed."""

import platform
from collections.abc import Mapping, Sequence

from swarmwright.common.errors import RunError
from swarmwright.common.plug_in_code import is_plug_in
from swarmwright.common.revision import revision
from swarmwright.controllers import Representation
from swarmwright.methods import Method
from swarmwright.methods.rankings import Ranking
from swarmwright.runs.store import StoreReader
from swarmwright.runs.store.provenance import COMMIT, HASH_SEED, versions

Component = Method | Ranking | Representation
_SORTS: Mapping[type, str] = {Method: "method", Representation: "representation", Ranking: "ranking"}
_NO_PART = {"sqlite", COMMIT, HASH_SEED}
"""Recorded with the others; nothing is computed with it, or most changes of it change no record."""


class StrayedError(RunError):
    """A generation comes out differently: resuming again does not help."""


def strayed(
    reader: StoreReader, generation: int, components: Sequence[Component], edited: Sequence[str] = ()
) -> StrayedError:
    """Return the error for a generation that comes out differently when a run is resumed.

    Args:
        reader: of the run.
        generation: the first one that does.
        components: what the generation was made with.
        edited: in words, what was edited in the code of plug-ins since the run, and accepted.
    """
    return StrayedError(
        f"{reader.file}: the run cannot continue: generation {generation} comes out differently here"
        f"{_why(reader, components, edited)}"
    )


def _why(reader: StoreReader, components: Sequence[Component], edited: Sequence[str]) -> str:
    if edited:
        return (
            f", since the code that made it has changed: {', '.join(edited)}. Restore what was edited (the "
            f"run's copy is in {reader.file.parent / 'code'}), or start a new run"
        )
    first = reader.sessions()[0]
    then = {name: one for name, one in first.versions.items() if ":" not in name and name not in _NO_PART}
    now = versions([*then])
    others = [
        f"{name} {one} (here {now.get(name, 'it is not installed')})"
        for name, one in then.items()
        if now.get(name) != one
    ]
    if others:
        return (
            f". It was begun with {', '.join(others)}; use these versions, on a machine of the same kind, or "
            "start a new run"
        )
    for component in components:
        if is_plug_in(type(component)):
            sort = next(name for base, name in _SORTS.items() if isinstance(component, base))
            return (
                f": the {sort} {component.kind} does not give the same {_output_of(sort)} again; "
                f"`swarmwright.testing.check_{sort}({component.kind!r})` finds out why. Start a new run"
            )
    state, commits = "", (first.versions.get(COMMIT), revision())
    if commits[0] is not None and commits[0] != commits[1]:
        state = f" (commit {commits[0]}; here {commits[1] or 'it is not known'})"
    elsewhere = ""
    if first.machine != platform.platform():
        elsewhere = f", or it needs a machine of the same kind as {first.machine}"
    return (
        " although the versions are the same: the store was changed, or the run was made by an earlier state "
        f"of this version{state}{elsewhere}; `swarmwright runs verify {reader.file.parent}` checks the store"
    )


def _output_of(sort: str) -> str:
    return "fitness" if sort == "ranking" else "genomes"
