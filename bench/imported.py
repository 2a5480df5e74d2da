"""What an import left out, kept with the campaign: a later diagnosis of its rows lists it too."""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from bench.wording import counted
from models.dataset import Measurements


def import_config(file: Path, measured: Measurements) -> dict[str, Any]:
    """The configuration of an imported campaign: of which file, and which of its rows were left out, and why."""
    return {"imported_from": file.name, "left_out": [asdict(row) for row in measured.rejected]}


def left_out_by_import(config: Mapping[str, Any]) -> dict[str, Any]:
    """The same for the JSON answer of a diagnosis; nothing where nothing was left out, or nothing imported."""
    rows = config.get("left_out") or []
    return {"left_out_by_import": {"file": config["imported_from"], "rows": rows}} if rows else {}


def left_out_text(answer: Mapping[str, Any]) -> str:
    """How many rows that was, from such an answer; empty where none were.

    >>> left_out_text({"left_out_by_import": {"file": "theirs.csv", "rows": [{"row": 7}]}})
    '1 row of theirs.csv left out by its import'
    """
    before = answer.get("left_out_by_import")
    return (
        f"{counted(len(before['rows']), 'row')} of {before['file']} left out by its import" if before else ""
    )
