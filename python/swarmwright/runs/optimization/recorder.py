"""Store and report the generations of a run."""

from collections.abc import Iterator
from contextlib import contextmanager

from swarmwright.common.errors import PlugInError, RunError
from swarmwright.runs.optimization.account import Account
from swarmwright.runs.optimization.generation import OnGeneration, should_continue
from swarmwright.runs.store import StoreWriter
from swarmwright.servers.evaluation.base import FailureOf, Progress, build_error
from swarmwright.servers.rows import GenerationResult, Journal


class Recorder:
    """Passes generations to the store and to the callback.

    Without a callback, a generation may be stored while the next one is evaluated.

    Args:
        store: receives every generation.
        account: account of the run.
    """

    def __init__(self, store: StoreWriter, account: Account) -> None:
        self._store = store
        self._account = account
        self._last: GenerationResult | None = None  # not passed to the store yet
        self._failure_of: FailureOf = lambda _reason: None
        self._on_generation: OnGeneration | None = None
        self._on_progress: Progress | None = None
        self._waiting_for = ""  # what the evaluation waited for last; empty if nothing

    def begin(
        self, failure_of: FailureOf, on_generation: OnGeneration | None, on_progress: Progress | None
    ) -> None:
        """Set the callbacks; failure_of: the backend's function for errors of the simulation's code."""
        self._failure_of, self._on_generation, self._on_progress = failure_of, on_generation, on_progress

    def take(self, result: GenerationResult, *, later: bool) -> bool:
        """Store and report a generation; return whether to continue.

        later: store it in the next `store_last`, unless there is a callback.
        """
        self._last = result.with_digests() if later else result
        if self._on_generation is not None or not later:
            self.store_last()
        if self._on_generation is None:
            return True
        self._store.keep()  # reported generations survive a killed process
        return should_continue(self._on_generation(self._account.report(result.summary, self._waiting_for)))

    def store_last(self) -> None:
        """Store the last generation if it is not stored yet."""
        last, self._last = self._last, None
        if last is not None:
            self._store.commit(last)
            self._account.stored = last.generation + 1

    def use_idle_time(self) -> None:
        """Let the store use idle time."""
        self._store.use_idle_time()

    @contextmanager
    def keep_journal(self, generation: int, journal: Journal) -> Iterator[None]:
        """Keep the journal even if the generation fails, and add the reason to the error."""
        try:
            yield
        except RunError as error:
            self._store.note(generation, journal)
            reasons = journal.errors
            if not reasons or isinstance(error, PlugInError):  # not an error of failed episodes
                raise
            last = build_error(f"{error}; the last reason: ", reasons, self._failure_of)
            raise last from last.__cause__ or error.__cause__

    def progress(self, done: int, total: int, waiting_for: str) -> None:
        """Report the progress of an evaluation, and note what it waits for."""
        self._waiting_for = waiting_for if done < total else ""
        self._store.keep_soon()  # needed while a first generation takes long
        if self._on_progress is not None:
            self._on_progress(done, total, waiting_for)
