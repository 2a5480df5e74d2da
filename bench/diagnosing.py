"""Diagnoses of what was measured: refused in words where a table allows none, and the answer that is kept of one."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from bench.errors import BenchError
from bench.imported import left_out_by_import
from bench.so_far import measured_so_far

if TYPE_CHECKING:
    from models.dataset import Measurements
    from models.diagnosis.diagnose import Diagnosis
    from models.diagnosis.stretches import Stretch


class NotDiagnosed(BenchError):
    """The measurements allow no diagnosis; says what is missing, or wrong with them."""


@contextmanager
def refused_in_words() -> Iterator[None]:
    """Reading a table and diagnosing it; NotDiagnosed in the place of what either refuses it with."""
    from models.dataset import DatasetError  # here: they load slowly
    from models.diagnosis.plausibility import ImplausibleTable
    from models.diagnosis.usable import TooFewPoints

    try:
        yield
    except (DatasetError, ImplausibleTable, TooFewPoints) as error:
        raise NotDiagnosed(str(error)) from error


def answer_of(
    found: "Diagnosis",
    measured: "Measurements",
    campaign: Mapping[str, Any] | None,
    model: str | None,
    apart: "Sequence[Stretch]" = (),
) -> dict[str, Any]:
    """The answer for programs and the database: what was found, and how the table was read; of a campaign, as the
    store tells it, how much of it was measured and what its import left out. ``model`` is the extended one's file.

    ``apart`` is what the stretches say on their own where something changed on the way.
    """
    from models.diagnosis.observations import taken_for_granted  # here: it loads slowly

    before = {} if campaign is None else measured_so_far(campaign) | left_out_by_import(campaign["config"])
    granted = taken_for_granted(measured.frame, found.baseline.converter)
    plain = found.as_plain(model) | {"notes": [*measured.notes, *granted]} | before
    if apart:
        plain["unknown"]["onset"]["stretches"] = [stretch.as_plain() for stretch in apart]
    return plain
