"""Files of a candidate to take along: code, a bundle, its replay as a page, a film or a picture."""

import re
import secrets
import threading
import zipfile
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from swarmwright import InputError, Run, export_bundle, export_controller
from swarmwright.controllers.teams import parts_of
from swarmwright.display.files import FORMATS
from swarmwright.export import EXPORTERS
from swarmwright.ui.replays import limit_replay

BUNDLE = "bundle"
FILE_BYTES = 64 << 20
"""Largest file; a film of hours belongs on the command line."""
KEPT_BYTES = 128 << 20
"""All files that are kept until they are fetched."""
KEPT_FILES = 20
LONGEST_NAME = 60
"""Characters of a run's name in the names of files."""
MEDIA_TYPES = {
    ".html": "text/html",
    ".gif": "image/gif",
    ".mp4": "video/mp4",
    ".png": "image/png",
    ".zip": "application/zip",
}
SLOWEST, FASTEST = 0.1, 100.0
"""Speeds of films."""


@dataclass(frozen=True)
class Export:
    """A file that was made."""

    name: str
    """Of the file: letters, digits, `_`, `-` and `.`."""
    content: bytes
    lines: tuple[str, ...] = ()
    """What was compared with the simulation, and the result."""
    is_verified: bool | None = None
    """Whether all comparisons succeeded; None without any."""

    @property
    def media_type(self) -> str:
        """The type of the file for browsers."""
        return MEDIA_TYPES.get(Path(self.name).suffix, "application/octet-stream")


class ExportShelf:
    """The newest files, until browsers fetch them."""

    def __init__(self) -> None:
        self._exports: OrderedDict[str, Export] = OrderedDict()
        self._lock = threading.Lock()

    def put(self, export: Export) -> str:
        """Keep a file; return its name in addresses. Raises InputError for a file that is too large."""
        if len(export.content) > FILE_BYTES:
            raise InputError(
                f"{export.name}: has {len(export.content) >> 20} MiB, but at most {FILE_BYTES >> 20} MiB can "
                "be downloaded; write it with `swarmwright replay RUN --save FILE`"
            )
        export_id = secrets.token_urlsafe(12)
        with self._lock:
            self._exports[export_id] = export
            while (
                len(self._exports) > KEPT_FILES
                or sum(len(each.content) for each in self._exports.values()) > KEPT_BYTES
            ):
                self._exports.popitem(last=False)
        return export_id

    def get(self, export_id: str) -> Export:
        """Return a file. Raises InputError when it is not kept any more."""
        with self._lock:
            export = self._exports.get(export_id)
        if export is None:
            raise InputError("this file is not kept any more; export it again")
        return export


def list_exports(run: Run) -> dict[str, Any]:
    """Return the formats of controllers and of replays, and the groups that have controllers of their own."""
    groups = list(parts_of(run.best.specification)) if run.history else []
    forms = list(EXPORTERS.names())
    return {"forms": forms, "media": list(FORMATS), "groups": groups, "has_bundle": not groups}


def export_code(
    run: Run,
    form: str,
    *,
    generation: int | None,
    candidate: int | None,
    group: str | None,
    verify: bool,
) -> Export:
    """Return the controller of a candidate as code or as a model; several files as an archive.

    Raises the errors of `export_controller`.
    """
    with TemporaryDirectory() as folder:
        output = Path(folder) / "controller"
        exported = export_controller(
            run,
            to=form,
            output=output,
            generation=generation,
            candidate=candidate,
            group=group,
            verify=verify,
        )
        verification = exported.verification
        lines: tuple[str, ...] = ()
        if verification is not None:
            lines = (verification.words, *filter(None, [verification.without_episodes]))
        name = file_name(run, generation, candidate, form, group)
        ok = None if verification is None else verification.ok
        if len(exported.files) == 1:
            file = exported.files[0]
            return Export(f"{name}{safe(file.suffix)}", file.read_bytes(), lines, ok)
        content = BytesIO()
        with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
            for file in sorted(exported.files):
                archive.write(file, f"{name}/{file.relative_to(output)}")
        return Export(f"{name}.zip", content.getvalue(), lines, ok)


def make_bundle(run: Run, *, generation: int | None, candidate: int | None) -> Export:
    """Return an archive with every format and the record of its evaluation.

    Raises the errors of `export_bundle`.
    """
    with TemporaryDirectory() as folder:
        file = Path(folder) / "bundle.zip"
        bundle = export_bundle(run, file, generation=generation, candidate=candidate)
        lines = (
            *(f"{form}: {verification.words}" for form, verification in bundle.verified.items()),
            *(f"{form}: not verified: {reason}" for form, reason in bundle.unverified.items()),
            *(f"{form}: left out: {reason}" for form, reason in bundle.without.items()),
            f"SHA-256 of the manifest: {bundle.digest}",
        )
        name = file_name(run, generation, candidate, BUNDLE)
        ok = all(verification.ok for verification in bundle.verified.values()) if bundle.verified else None
        return Export(f"{name}.zip", file.read_bytes(), lines, ok)


def export_replay(run: Run, ending: str, options: Mapping[str, Any], speed: float) -> Export:
    """Return the replay of an episode as a page, a film or a picture.

    options: as of `Run.replay`. speed: of films. Raises the errors of `Run.replay` and of `ReplayPage.save`.
    """
    if not SLOWEST <= speed <= FASTEST:
        raise InputError(f"speed: must be from {SLOWEST:g} to {FASTEST:g}, not {speed:g}")
    with TemporaryDirectory() as folder, limit_replay():
        replay = run.replay(**options, speed=speed)
        file = Path(folder) / f"replay{ending}"
        replay.save(file)
        seed = f"seed-{replay.seed}"
        if options.get("match"):
            name = join_name(run, *map(str, options["match"]), seed)
        else:
            name = file_name(run, options.get("generation"), options.get("candidate"), seed)
        return Export(f"{name}{ending}", file.read_bytes())


def file_name(run: Run, generation: int | None, candidate: int | None, *words: str | None) -> str:
    """Return the name of a file without suffix: of the run, the candidate and other words."""
    evaluation = run.evaluation(candidate, generation)
    return join_name(run, f"{evaluation.generation}-{evaluation.candidate}", *filter(None, words))


def join_name(run: Run, *words: str) -> str:
    """Return the name of a file without suffix: of the run and other words."""
    return safe("-".join([run.path.resolve().name[:LONGEST_NAME], *words]))


def safe(text: str) -> str:
    """Return a text as part of a file's name: other characters than letters, digits, `.`, `-` become `_`."""
    return re.sub(r"[^A-Za-z0-9.-]+", "_", text).strip("_") or "_"
