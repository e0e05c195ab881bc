"""Storing and reporting the generations of a run."""

from collections.abc import Iterator
from contextlib import contextmanager

from swarmwright.common.errors import PlugInError, RunError
from swarmwright.runs.optimization.account import Account
from swarmwright.runs.optimization.generation import OnGeneration, goes_on
from swarmwright.runs.store import StoreWriter
from swarmwright.servers.evaluation.base import Progress
from swarmwright.servers.evaluation.code_failures import FailureOf, build_error
from swarmwright.servers.rows import GenerationResult, Journal


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
        self._last: GenerationResult | None = None  # until it is handed to the store
        self._failure_of: FailureOf = lambda _reason: None
        self._on_generation: OnGeneration | None = None
        self._on_progress: Progress | None = None
        self._waiting_for = ""  # what the evaluation waited for last; empty when it waited for nothing

    def begin(
        self, failure_of: FailureOf, on_generation: OnGeneration | None, on_progress: Progress | None
    ) -> None:
        """Take who is told, and what tells failures of the simulation's code from others: the backend's."""
        self._failure_of, self._on_generation, self._on_progress = failure_of, on_generation, on_progress

    def take(self, result: GenerationResult, *, later: bool) -> bool:
        """Store a generation and report it; return whether to go on.

        later: store it with `store_last`, unless there is a callback, which waits for that.
        """
        self._last = result.with_digests() if later else result
        if self._on_generation is not None or not later:
            self.store_last()
        if self._on_generation is None:
            return True
        self._store.keep()  # what is reported is kept, even when the process is killed
        return goes_on(self._on_generation(self._account.report(result.summary, self._waiting_for)))

    def store_last(self) -> None:
        """Store the last generation, unless that was done."""
        last, self._last = self._last, None
        if last is not None:
            self._store.commit(last)
            self._account.stored = last.generation + 1

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
            last = build_error(f"{error}; the last reason: ", reasons, self._failure_of)
            raise last from last.__cause__ or error.__cause__

    def progress(self, done: int, total: int, waiting_for: str) -> None:
        """Tell how far an evaluation is, and note what is waited for."""
        self._waiting_for = waiting_for if done < total else ""
        self._store.keep_soon()  # also while the first generation takes long
        if self._on_progress is not None:
            self._on_progress(done, total, waiting_for)
