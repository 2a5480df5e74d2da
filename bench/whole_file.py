"""Files that appear whole: a reader sees the old one or the new one, never half of it.

Where the disk is full, or the place may not be written, the error names the file itself and says what to do.
"""

import errno
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bench.errors import NotWritten

NO_ROOM = {errno.ENOSPC: "the disk is full", errno.EDQUOT: "the disk space allowed is used up"}
_NOT_ALLOWED = {
    errno.EROFS: "the file system is read-only",
    errno.EACCES: "this user may not write there",
    errno.EPERM: "this user may not write there",
}


def why_not(error: OSError) -> str:
    """Why nothing was written, in words.

    >>> why_not(OSError(errno.ENOSPC, "No space left on device")), why_not(OSError(errno.EIO, "Input/output error"))
    ('the disk is full', 'Input/output error')
    """
    known = {**NO_ROOM, **_NOT_ALLOWED}
    return known.get(error.errno or 0) or error.strerror or str(error)


def what_to_do(error: OSError) -> str:
    """What helps where nothing was written.

    >>> what_to_do(OSError(errno.ENOSPC, ""))
    'make room, or name another folder'
    """
    first = "make room, or " if error.errno in NO_ROOM else ""
    return f"{first}name another folder"


@contextmanager
def told_of(path: Path) -> Iterator[None]:
    """NotWritten of ``path``, whatever name it was written under, for an error of the disk inside."""
    try:
        yield
    except OSError as error:
        raise NotWritten(f"{path} cannot be written: {why_not(error)}; {what_to_do(error)}") from error


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A name to write to, which becomes ``path`` in one step at the end; after an error ``path`` is as it was."""
    with told_of(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        os.close(handle)
        written = Path(name)
        try:
            yield written
            with written.open("rb") as file:
                os.fsync(file.fileno())
            written.chmod(0o644)
            written.replace(path)
        except BaseException:
            written.unlink(missing_ok=True)
            raise


def write_whole(path: Path, content: str | bytes) -> None:
    """Replace ``path`` by that content, in one step."""
    with replacing(path) as file:
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
