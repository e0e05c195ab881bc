"""Zip archives that are small, and would unpack to gigabytes; and damaged ones."""

import struct
import zipfile
from pathlib import Path

import pytest

from swarmwright import InputError
from swarmwright.common import archives


def packed(file: Path, method: int = zipfile.ZIP_DEFLATED, **content: bytes) -> Path:
    with zipfile.ZipFile(file, "w", method) as archive:
        for name, data in content.items():
            archive.writestr(name, data)
    return file


def test_what_an_archive_unpacks_to_is_limited(tmp_path: Path) -> None:
    file = tmp_path / "x.zip"
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("zeros", "w") as stream:
        for _ in range(300):
            stream.write(bytes(1 << 20))
    expected = r"x\.zip: unpacks to 300 MiB, more than 256 MiB and 20 times its own size; .*zip -0"
    with pytest.raises(InputError, match=expected), archives.open_archive(file, "an archive"):
        pass


def test_the_limit_follows_the_size_of_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """So that a large archive without compression is read."""
    monkeypatch.setattr(archives, "_UNPACKED_BYTES", 1000)
    for method in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        file = packed(tmp_path / f"{method}.zip", method, zeros=bytes(100_000))
        if method == zipfile.ZIP_STORED:
            with archives.open_archive(file, "an archive") as archive:
                assert archives.read_entry(archive, file, "zeros", 100_000) == bytes(100_000)
        else:
            with pytest.raises(InputError, match="unpacks to"), archives.open_archive(file, "an archive"):
                pass


def test_an_entry_that_says_less_than_it_has(tmp_path: Path) -> None:
    file = packed(tmp_path / "x.zip", zeros=bytes(1 << 22))
    file.write_bytes(file.read_bytes().replace(struct.pack("<I", 1 << 22), struct.pack("<I", 1000)))
    with (
        pytest.raises(
            InputError, match=r"x\.zip: is not an archive, or is damaged: Bad CRC-32 for file 'zeros'"
        ),
        archives.open_archive(file, "an archive") as archive,
    ):
        archives.read_entry(archive, file, "zeros", 1 << 20)


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_methods_whose_output_cannot_be_limited(tmp_path: Path, method: int) -> None:
    file = packed(tmp_path / "x.zip", method, zeros=bytes(1000))
    with (
        pytest.raises(InputError, match=f"zeros: is compressed by method {method}; expected deflate or none"),
        archives.open_archive(file, "an archive"),
    ):
        pass


@pytest.mark.parametrize("name", ["/etc/x", "../x", "a/../../x", "C:x", "a\\x"])
def test_names_outside_of_the_folder(tmp_path: Path, name: str) -> None:
    file = packed(tmp_path / "x.zip", zipfile.ZIP_DEFLATED, **{name: b""})
    with (
        pytest.raises(InputError, match="is not a name inside a folder"),
        archives.open_archive(file, "an archive"),
    ):
        pass


def test_the_number_of_entries_is_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archives, "_MOST_ENTRIES", 2)
    file = packed(tmp_path / "x.zip", a=b"", b=b"", c=b"")
    with (
        pytest.raises(InputError, match=r"x\.zip: has 3 entries, more than 2"),
        archives.open_archive(file, "an archive"),
    ):
        pass


def test_entries_have_a_limit_of_their_own(tmp_path: Path) -> None:
    file = packed(tmp_path / "x.zip", zeros=bytes(3 << 20))
    with archives.open_archive(file, "an archive") as archive:
        with pytest.raises(InputError, match="zeros has 3 MiB, more than 2 MiB, the limit"):
            archives.read_entry(archive, file, "zeros", 2 << 20)
        with pytest.raises(InputError, match=r"x\.zip: has no ones"):
            archives.read_entry(archive, file, "ones", 2 << 20)
