"""What an import left out, kept with the campaign: a later diagnosis of its rows lists it too."""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from bench.wording import counted
from models.dataset import Measurements
from models.switching_frequency import StatedFrequency, stated_frequencies


def import_config(file: Path, measured: Measurements) -> dict[str, Any]:
    """The configuration of an imported campaign: of which file, which of its rows were left out, and why, and at which
    switching frequencies it says that they were measured."""
    stated = stated_frequencies(measured.frame, measured.rows)
    return {
        "imported_from": file.name,
        "left_out": [asdict(row) for row in measured.rejected],
        "switching_frequencies": [asdict(each) for each in stated],
    }


def frequencies_by_import(config: Mapping[str, Any]) -> tuple[StatedFrequency, ...]:
    """The switching frequencies that an imported table stated; none of a campaign of one's own."""
    return tuple(StatedFrequency(**each) for each in config.get("switching_frequencies") or ())


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
