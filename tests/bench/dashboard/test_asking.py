"""Pause, resume, abort: asked through the database; asking twice is no harm and is said."""

import pytest

from bench.dashboard.asking import Request, ask
from bench.errors import BenchError
from bench.states import State
from bench.store import Store
from tests.bench.dashboard.stored import running_campaign


def test_two_people_who_abort_are_both_told(store: Store) -> None:
    campaign = running_campaign(store)
    assert "switches the bench off and ends" in ask(store, campaign, Request.ABORT)
    assert "was already asked to abort" in ask(store, campaign, Request.ABORT)
    assert "was already asked to abort" in ask(store, campaign, Request.RESUME)
    assert store.asked(campaign) == "abort"


def test_a_pause_is_taken_back_by_resuming(store: Store) -> None:
    campaign = running_campaign(store)
    ask(store, campaign, Request.PAUSE)
    assert store.asked(campaign) == "pause"
    assert "already asked to pause" in ask(store, campaign, Request.PAUSE)
    ask(store, campaign, Request.RESUME)
    assert store.asked(campaign) is None
    assert "is not paused" in ask(store, campaign, Request.RESUME)


def test_a_campaign_that_has_ended_or_never_was_is_said(store: Store) -> None:
    campaign = running_campaign(store)
    store.end(campaign, State.DONE, power_off="all off")
    with pytest.raises(BenchError, match="is not running: it is done"):
        ask(store, campaign, Request.ABORT)
    with pytest.raises(BenchError, match="there is no campaign 9"):
        ask(store, 9, Request.ABORT)
