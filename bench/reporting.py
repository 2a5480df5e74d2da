"""Tells a live screen, through the store, what a campaign does now; no more often than people can look."""

import math
import time
from collections.abc import Callable, Mapping

from bench.instruments import Sample
from bench.store import LinkReport, Moment, Settling, Store

LEAST_S = 0.2  # real seconds between two writes of one phase

Links = Callable[[], Mapping[str, LinkReport]]


class Reporter:
    """Writes the present moment of one campaign."""

    def __init__(self, store: Store, campaign_id: int, time_s: Callable[[], float]) -> None:
        self._store, self._id, self._time_s = store, campaign_id, time_s
        self._links: Links = dict
        self._phase = "checking"
        self._point_id: int | None = None
        self._readings: Mapping[str, float] = {}
        self._settling: Settling | None = None
        self._written = -math.inf

    def attach(self, links: Links) -> None:
        """From now on, links are reported, too."""
        self._links = links

    def moment(self, phase: str, *, point_id: int | None = None, faults: tuple[str, ...] = ()) -> None:
        """A phase begins, or goes on; of no point, or of one."""
        begins = phase != self._phase or bool(faults)
        self.phase(phase, point_id)
        self._write(faults, at_once=begins and phase != "setting")

    def phase(self, phase: str, point_id: int | None) -> None:
        """What the next moment will be of."""
        self._phase, self._point_id = phase, point_id
        self._settling = None

    def sampled(self, sample: Sample) -> None:
        """A sample was taken."""
        efficiency = {"efficiency": sample.efficiency} if math.isfinite(sample.efficiency) else {}
        self._readings = {**sample.values, **efficiency}
        self._write()

    def settles(self, settling: Settling) -> None:
        """How far the point has settled; written with the next sample."""
        self._settling = settling

    def _write(self, faults: tuple[str, ...] = (), *, at_once: bool = False) -> None:
        now = time.monotonic()
        if not at_once and now - self._written < LEAST_S:
            return
        self._written = now
        moment = Moment(
            phase=self._phase,
            time_s=self._time_s(),
            point_id=self._point_id,
            readings=self._readings,
            settling=self._settling,
            instruments=self._links(),
            faults=faults,
        )
        self._store.live.write(self._id, moment)
