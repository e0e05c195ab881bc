"""Tags and a note that users attach to a run, stored beside its record."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from swarmwright.common.errors import InputError
from swarmwright.common.files import read_bytes, write_whole

FILE = "notes.json"
MOST_TAGS = 20
MOST_TAG_CHARACTERS = 50
MOST_NOTE_CHARACTERS = 10_000
_MOST_BYTES = 1 << 18


@dataclass(frozen=True)
class Annotations:
    """Tags and a note of users about a run. They do not influence it, and are not part of its record.

    Args:
        tags: words to find it by; at most 20, of at most 50 characters, without commas.
        note: any text of at most 10,000 characters.

    Raises InputError for anything else.
    """

    tags: tuple[str, ...] = ()
    note: str = ""

    def __post_init__(self) -> None:
        if len(self.tags) > MOST_TAGS:
            raise InputError(f"tags: a run has at most {MOST_TAGS}, not {len(self.tags)}")
        for tag in self.tags:
            if not 1 <= len(tag) <= MOST_TAG_CHARACTERS or not tag.isprintable() or "," in tag:
                raise InputError(
                    f"tags: {tag[:100]!r}: use 1 to {MOST_TAG_CHARACTERS} printable characters without commas"
                )
            if tag != tag.strip() or self.tags.count(tag) > 1:
                raise InputError(f"tags: {tag!r}: is repeated or begins or ends with a space")
        if len(self.note) > MOST_NOTE_CHARACTERS:
            raise InputError(f"note: has {len(self.note):,} characters; use at most {MOST_NOTE_CHARACTERS:,}")


def read_annotations(folder: Path) -> Annotations:
    """Return the annotations of a run folder; empty ones if it has none.

    Raises InputError if the file is damaged or cannot be read.
    """
    path = folder / FILE
    try:
        values = json.loads(read_bytes(path, _MOST_BYTES))
        tags, note = values["tags"], values["note"]
        if not (
            isinstance(note, str) and isinstance(tags, list) and all(isinstance(tag, str) for tag in tags)
        ):
            raise TypeError
        return Annotations(tuple(tags), note)
    except FileNotFoundError:
        return Annotations()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, TypeError, KeyError, RecursionError):
        raise InputError(
            f'{path}: must be JSON such as {{"tags": ["thesis"], "note": "text"}}; correct or delete it'
        ) from None


def write_annotations(folder: Path, tags: Sequence[str], note: str) -> Annotations:
    """Replace the annotations of a run folder; return them.

    Raises InputError if they are invalid or cannot be written.
    """
    annotations = Annotations(tuple(tags), note)
    path = folder / FILE
    if path.is_symlink():  # the folder may come from an untrusted source
        raise InputError(f"{path}: is a link; delete it")
    try:
        encoded = json.dumps({"tags": annotations.tags, "note": annotations.note}, ensure_ascii=False)
        write_whole(path, encoded.encode() + b"\n")
    except UnicodeEncodeError:
        raise InputError("note, tags: are not valid Unicode") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None
    return annotations
