"""How much of a campaign's plan its measured rows are: what a diagnosis of a campaign that stopped has to say first."""

from collections.abc import Mapping
from typing import Any

from bench.states import STOPPED, State


def measured_so_far(campaign: Mapping[str, Any]) -> dict[str, Any]:
    """That for the JSON answer of a diagnosis, from a campaign as the store tells it."""
    told = {name: campaign[name] for name in ("id", "name", "planned", "accepted", "rejected")}
    return {"campaign": told | {"state": str(campaign["shown"])}}


def so_far_text(answer: Mapping[str, Any]) -> str:
    """What of the plan is not there, from such an answer; empty where all of it is.

    >>> of = {"id": 3, "planned": 50, "accepted": 26, "rejected": 1, "state": "interrupted"}
    >>> so_far_text({"campaign": of | {"state": "running"}})
    '26 of 50 planned rows were measured, 1 was rejected, and the campaign is running'
    """
    of = answer.get("campaign")
    if not of or of["accepted"] >= of["planned"]:
        return ""
    rejected = (
        ""
        if not of["rejected"]
        else f", {of['rejected']} {'was' if of['rejected'] == 1 else 'were'} rejected"
    )
    said = f"{of['accepted']} of {of['planned']} planned rows were measured{rejected}"
    if of["accepted"] + of["rejected"] >= of["planned"]:
        return f"{said}: d2ea status {of['id']} says why"
    if of["state"] == State.DONE:
        return said
    said += f", and the campaign is {of['state']}"
    waits = of["state"] in {*STOPPED, State.PAUSED}
    return f"{said}: d2ea resume {of['id']} measures the rest" if waits else said
