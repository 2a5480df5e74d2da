"""The campaign database: the only place that writes campaign data.

::

    with Store(url) as store:
        store.campaigns(), store.measurement_table(7)    # reading: reader.py
        store.judged(7, after=8, until=9)                # what is new, for a live screen: following.py
        store.create_campaign(...), store.advance(...)   # a campaign's and its points' lives: ledger.py
        store.import_table(...), store.add_diagnosis()   # what is kept beside them: archive.py
        store.benches.all()                              # owners, energised, UNSAFE: benches.py
        store.live.read(7)                               # what goes on at this moment: live.py
        store.queue.due(now)                             # campaigns that wait: queue.py
"""

from typing import Self

from bench.store.archive import Archive
from bench.store.benches import Benches, BenchRow, BenchState
from bench.store.database import DEFAULT_URL, Database, database_url, how_to_name
from bench.store.following import Following
from bench.store.ledger import Ledger, Provenance, Session, StoredReading
from bench.store.live import LinkReport, Live, Moment, SeenMoment, Settling
from bench.store.queue import Entry, Queue
from bench.store.reader import Reader, Row
from bench.store.tables import COLUMNS
from bench.versions import versions

__all__ = [
    "COLUMNS",
    "DEFAULT_URL",
    "BenchRow",
    "BenchState",
    "Entry",
    "LinkReport",
    "Moment",
    "Provenance",
    "Row",
    "SeenMoment",
    "Session",
    "Settling",
    "Store",
    "StoredReading",
    "database_url",
    "how_to_name",
    "versions",
]


class Store(Reader, Following, Ledger, Archive):
    """An open campaign database."""

    def __init__(self, url: str) -> None:
        super().__init__(Database(url))
        self.url = self._db.url
        self.benches = Benches(self._db)
        self.live = Live(self._db)
        self.queue = Queue(self._db)

    @property
    def database(self) -> Database:
        """The connections behind it."""
        return self._db

    def close(self) -> None:
        """Close all connections."""
        self._db.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
