"""Files appear whole: the old one stays until the new one is there, and an error leaves nothing behind."""

import errno
import os
from pathlib import Path

import pytest

from bench.errors import NotWritten
from bench.whole_file import replacing, write_whole


def test_a_reader_sees_the_old_file_until_the_new_one_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "made" / "x.txt"
    write_whole(path, "old")
    with replacing(path) as file:
        file.write_text("half")
        assert path.read_text() == "old"
    assert path.read_text() == "half"
    assert path.stat().st_mode & 0o777 == 0o644
    assert list(path.parent.iterdir()) == [path]


def test_bytes_are_written_as_they_are_and_text_as_utf_8(tmp_path: Path) -> None:
    path = tmp_path / "x"
    for content, written in ((b"\x89PNG\r\n", b"\x89PNG\r\n"), ("71 mΩ\n", b"71 m\xce\xa9\n")):
        write_whole(path, content)
        assert path.read_bytes() == written


def half_written(path: Path) -> None:
    with replacing(path) as file:
        file.write_text("half")
        raise OSError("no space left")


def test_an_error_leaves_the_old_file_and_nothing_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "x.txt"
    write_whole(path, "old")
    with pytest.raises(NotWritten, match="no space left"):
        half_written(path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("code", "said"),
    [
        (errno.ENOSPC, "the disk is full; make room, or name another folder"),
        (errno.EROFS, "the file system is read-only; name another folder"),
        (errno.EACCES, "this user may not write there; name another folder"),
        (errno.EIO, "Input/output error; name another folder"),
    ],
)
def test_what_is_told_is_the_file_itself_why_and_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int, said: str
) -> None:
    def fail(**beside: object) -> None:
        raise OSError(code, os.strerror(code), f"{tmp_path}/.x.txt.temporary")

    monkeypatch.setattr("bench.whole_file.tempfile.mkstemp", fail)
    with pytest.raises(NotWritten) as told:
        write_whole(tmp_path / "x.txt", "new")
    assert str(told.value) == f"{tmp_path}/x.txt cannot be written: {said}"
