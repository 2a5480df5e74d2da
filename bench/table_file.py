"""Tables of numbers as files: CSV or Parquet, by the file's ending."""

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

from bench.errors import InputError
from bench.whole_file import replacing

if TYPE_CHECKING:
    import pandas as pd

ENDINGS = (".csv", ".parquet")


def check_ending(path: Path, option: str = "--out") -> None:
    """InputError for a file name that is neither CSV nor Parquet."""
    if path.suffix not in ENDINGS:
        raise InputError.of("command line", option, str(path), f"the name must end in {' or '.join(ENDINGS)}")


def write_table(table: "pd.DataFrame", path: Path) -> None:
    """Write ``table`` in one step; a number read back is the number written."""
    check_ending(path)
    with replacing(path) as file:
        if path.suffix == ".csv":
            table.to_csv(file, index=False)
        else:
            table.to_parquet(file, index=False)


def file_hash(path: Path) -> str:
    """SHA-256 of a file's bytes."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
