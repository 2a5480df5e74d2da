"""Pause, resume and abort: asked for through the database, obeyed by whoever runs the campaign.

Nothing here touches a bench. Asking twice is no harm, and is said.
"""

from enum import StrEnum

from bench.errors import BenchError
from bench.store import Store


class Request(StrEnum):
    """What an operator may ask of a campaign."""

    PAUSE = "pause"
    RESUME = "resume"
    ABORT = "abort"


STORED = {Request.PAUSE: "pause", Request.RESUME: None, Request.ABORT: "abort"}
THEN = {
    Request.PAUSE: "it finishes its point, switches the bench off and waits",
    Request.RESUME: "it goes on",
    Request.ABORT: "it switches the bench off and ends",
}


def ask(store: Store, campaign_id: int, request: Request) -> str:
    """Ask, and say what happens now.

    Raises BenchError when there is no such campaign, or nobody runs it.
    """
    row = store.campaign(campaign_id)
    if not row["is_live"]:
        raise BenchError(f"campaign {campaign_id} is not running: it is {row['shown']}")
    if row["request"] == "abort":
        return f"campaign {campaign_id} was already asked to abort; it is on its way to off"
    if row["request"] == STORED[request]:
        if request is Request.RESUME:
            return f"campaign {campaign_id} is not paused"
        return f"campaign {campaign_id} was already asked to {request}"
    store.ask(campaign_id, STORED[request])
    return f"asked campaign {campaign_id} to {request}: {THEN[request]}"
