"""How the plan of a running campaign grows: points are chosen while the bench is kept alive, then written down."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from sqlalchemy import RowMapping

from bench.adaptive import Choice, Chooses
from bench.instruments import Bench
from bench.job import planned
from bench.point import Campaign

Think = Callable[[Callable[[], Choice], Callable[[], None], float], Choice]
"""Does long work elsewhere; the second argument is called meanwhile, every so many real seconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Growth:
    """Lets the plan of one campaign grow."""

    of: Campaign
    think: Think

    def next_rows(self, bench: Bench) -> Sequence[RowMapping]:
        """The rows chosen next, in the ledger; none of a plan that is known to its end, or has come to it."""
        campaign = self.of
        if campaign.job.choose is None:
            return []
        campaign.reporter.moment("choosing")
        campaign.tracker.say("choosing the next points")
        began_s = time.perf_counter()
        choice = self._chosen(bench, campaign.job.choose)
        waited = (
            f"{len(choice.rows)} rows chosen; the bench waited {time.perf_counter() - began_s:.1f} s for it"
        )
        campaign.store.grow(campaign.id, choice.rows, time_s=campaign.time_s(), said=[*choice.said, waited])
        for line in choice.said:
            campaign.tracker.say(line)
        return campaign.store.unfinished(campaign.id)

    def _chosen(self, bench: Bench, choose: Chooses) -> Choice:
        """The choice from all accepted rows; the bench gets its heartbeat meanwhile, and the operator is heard."""
        campaign, config = self.of, self.of.job.bench
        rows = [planned(row) for row in campaign.store.predictions(campaign.id).to_dict(orient="records")]
        work = partial(choose, campaign.store.measurement_table(campaign.id), rows)

        def meanwhile() -> None:
            bench.beat()
            campaign.attend()

        return self.think(work, meanwhile, config.controller.heartbeat_s / config.speed / 2)
