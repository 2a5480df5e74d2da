"""Models and tables as the pages show them; a registry that cannot be read is said, not raised."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.dashboard.view import clock
from bench.lut_file import BESIDE
from bench.training import HELD_OUT
from bench.wording import MODEL_NAMES, points_text
from models.journal import Journal
from models.registry import Registry, RegistryError

DECISIONS = 50  # shown
MODELS = 12  # in the picture
LABS = {True: "virtual lab", False: "hardware", None: "not stated"}


def in_use(registry: Registry) -> str | None:
    """The model in use; None when there is none, or the journal cannot be read."""
    try:
        return Journal(registry.root).in_use()
    except RegistryError:
        return None


def model_rows(registry: Registry) -> list[dict[str, Any]]:
    """The models as words, the newest first."""
    used = in_use(registry)
    return [
        {
            "id": record.id,
            "used": record.id == used,
            "kind": MODEL_NAMES.get(record.kind, record.kind),
            "error": points_text(record.metrics.get(HELD_OUT)),
            "lab": LABS[record.virtual],
            "created": clock(record.created),
            "data": record.data or "–",
        }
        for record in reversed(registry.list())
    ]


def model_errors(registry: Registry) -> list[tuple[str, float]]:
    """(name, held-out error) of the last models."""
    used = in_use(registry)
    known = [record for record in registry.list() if record.metrics.get(HELD_OUT) is not None]
    return [
        (f"{record.id}{' (in use)' if record.id == used else ''}", record.metrics[HELD_OUT])
        for record in known[-MODELS:]
    ]


def decision_rows(registry: Registry) -> list[dict[str, str]]:
    """What was decided, the newest first."""
    try:
        decisions = Journal(registry.root).decisions()
    except RegistryError as error:
        return [{"when": "", "what": "unreadable", "level": "kept_out", "model": "", "reason": str(error)}]
    return [
        {
            "when": clock(entry.when),
            "what": entry.decision.replace("_", " "),
            "level": str(entry.decision),
            "model": entry.model,
            "reason": entry.reason,
        }
        for entry in reversed(decisions[-DECISIONS:])
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class Optimum:
    """The table of a model as the page shows it, or why there is none."""

    table: dict[str, Any] | None
    said: str = ""


def chosen_optimum(registry: Registry) -> Optimum:
    """The table of the model in use, else of the newest model that has one."""
    used = in_use(registry)
    candidates = [used] if used else [record.id for record in reversed(registry.list())]
    for id in candidates:
        file = registry.root / id / "lut.json"
        if file.is_file():
            return _read(file, id)
    wanted = f"Model {used} is in use and has no table" if used else "No table of the best modulation yet"
    return Optimum(table=None, said=f"{wanted}: d2ea optimise and d2ea retrain make one.")


def _read(file: Path, id: str) -> Optimum:
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        unsound = sum(
            not line["carries"]
            or line["zero_state_appears"]
            or bool(line["lost_edges"])
            or line["dip"] is None
            for line in content["lines"]
        )
        checked = "Checked between its rows" if not unsound else f"{unsound} lines between rows are unsound"
        files = [name for name in BESIDE if (file.parent / name).is_file()]
        return Optimum(
            table={
                "id": id,
                "kind": MODEL_NAMES.get(content["kind"], content["kind"]),
                "lab": content["lab"],
                "checked": f"{checked}.",
                "rows": content["table"],
                "files": files,
            }
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        return Optimum(table=None, said=f"{file} cannot be read: {error}")
