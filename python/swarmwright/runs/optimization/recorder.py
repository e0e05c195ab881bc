"""Storing and reporting the generations of a run."""

from collections.abc import Iterator
from contextlib import contextmanager

from swarmwright import _engine
from swarmwright.common.arrays import Genomes
from swarmwright.common.errors import PlugInError, RunError
from swarmwright.runs.optimization.account import Account
from swarmwright.runs.optimization.generation import OnGeneration, Told, goes_on
from swarmwright.runs.store import StoreWriter
from swarmwright.servers.evaluation.base import Progress
from swarmwright.servers.evaluation.code_failures import FailureOf, failed
from swarmwright.servers.rows import Evaluated, Journal


class Recorder:
    """Hands generations to the store and to the callback.

    Where the last generation is not waited for, it is stored while the next one is evaluated.

    Args:
        store: where every generation goes.
        account: of the run.
    """

    def __init__(self, store: StoreWriter, account: Account) -> None:
        self._store = store
        self._account = account
        self._last: Told | None = None  # until it is handed to the store
        self._failure_of: FailureOf = lambda _reason: None
        self.waiting_for = ""
        """What the evaluation waited for last; empty when it waited for nothing."""

    def begin(self, failure_of: FailureOf) -> None:
        """Take what tells failures of the simulation's code from other reasons: the backend's."""
        self._failure_of = failure_of

    def keeps(self, sample: _engine.Sample, genomes: Genomes) -> bool:
        """Return whether the store keeps a sample instead of the genomes that are made from it."""
        return sample.is_shorter and len(sample) == len(genomes)

    def hold(self, told: Told) -> None:
        """Take the last generation, to be stored later."""
        self._last = told

    def store_last(self) -> None:
        """Store the generation that is held, if there is one."""
        told, self._last = self._last, None
        if told is not None:
            self._commit(told.evaluated(), told.found.results.journal)

    def report_last(self, on_generation: OnGeneration) -> bool:
        """Store the generation that is held and report it; return whether to go on."""
        told, self._last = self._last, None
        assert told is not None
        return self.finish(told.evaluated(), told.found.results.journal, on_generation)

    def finish(self, evaluated: Evaluated, journal: Journal, on_generation: OnGeneration | None) -> bool:
        """Store a generation and report it; return whether to go on."""
        self._commit(evaluated, journal)
        if on_generation is None:
            return True
        self._store.keep()  # what is reported is kept, even when the process is killed
        return goes_on(on_generation(self._account.report(evaluated.summary, self.waiting_for)))

    def has_time(self) -> None:
        """Tell the store that nothing else is to be done now."""
        self._store.has_time()

    @contextmanager
    def journal_kept(self, generation: int, journal: Journal) -> Iterator[None]:
        """Keep the journal also when the generation fails; name the reason."""
        try:
            yield
        except RunError as error:
            self._store.note(generation, journal)
            reasons = journal.errors
            if not reasons or isinstance(error, PlugInError):  # not for what failed episodes raised
                raise
            last = failed(f"{error}; the last reason: ", reasons, self._failure_of)
            raise last from last.__cause__ or error.__cause__

    def watched(self, on_progress: Progress | None) -> Progress:
        """Return the callback that also notes what is waited for."""

        def progress(done: int, total: int, waiting_for: str) -> None:
            self.waiting_for = waiting_for if done < total else ""
            self._store.keep_soon()  # also while the first generation takes long
            if on_progress is not None:
                on_progress(done, total, waiting_for)

        return progress

    def _commit(self, evaluated: Evaluated, journal: Journal) -> None:
        self._store.commit(evaluated, journal)
        self._account.stored = evaluated.generation + 1
