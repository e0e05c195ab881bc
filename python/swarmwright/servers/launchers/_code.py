"""Code of a custom simulation as an archive, to be copied to servers."""

import gzip
import hashlib
import io
import tarfile
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Self


@dataclass(frozen=True)
class Code:
    """Files of a simulation.

    Attributes:
        digest: SHA-256 of their names and contents, in hexadecimal.
        archive: the files as a gzip-compressed tar archive.
    """

    digest: str
    archive: bytes

    @classmethod
    def from_files(cls, files: Mapping[str, bytes], executable: Collection[str] = ()) -> Self:
        """Pack files, keyed by their path relative to a common folder; equal files give equal bytes.

        executable: paths of programs.
        """
        digest = hashlib.sha256()
        buffer = io.BytesIO()
        with (
            gzip.GzipFile(fileobj=buffer, mode="wb", mtime=0) as compressed,
            tarfile.open(fileobj=compressed, mode="w", format=tarfile.PAX_FORMAT) as archive,
        ):
            for name, data in sorted(files.items()):
                mode = 0o755 if name in executable else 0o644
                head = f"{name}\0{mode:o}\0{len(data)}\0"
                digest.update(head.encode() + data)
                entry = tarfile.TarInfo(name)
                entry.size, entry.mode = len(data), mode
                archive.addfile(entry, io.BytesIO(data))
        return cls(digest.hexdigest(), buffer.getvalue())

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the archive, in hexadecimal, to verify copies."""
        return hashlib.sha256(self.archive).hexdigest()

    def unpack(self, folder: Path) -> None:
        """Extract the files into a folder, which is created. Raises OSError."""
        folder.mkdir(parents=True, exist_ok=True)
        with tarfile.open(fileobj=io.BytesIO(self.archive)) as archive:
            # Python 3.11.2 (Debian 12) lacks the filters of `extractall`.
            for entry in archive:
                path = folder / entry.name
                content = archive.extractfile(entry)
                if content is None or not path.resolve().is_relative_to(folder.resolve()):
                    raise OSError(f"{entry.name}: not a file inside the folder")
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content.read())
                path.chmod(entry.mode & 0o755)
