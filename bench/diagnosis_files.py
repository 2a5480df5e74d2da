"""What is written of a diagnosis: a page for people, the answer for programs, the extended model, the residuals."""

import json
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from bench.diagnosing import answer_of
from bench.diagnosis_page import PAGE, DiagnosisPage, write_diagnosis_page
from bench.model_file import rests_on, write_model
from bench.table_file import write_table
from bench.whole_file import write_whole

if TYPE_CHECKING:
    from models.dataset import Measurements
    from models.diagnosis.diagnose import Diagnosis


class _Files(NamedTuple):
    page: str = PAGE
    answer: str = "diagnosis.json"
    model: str = "model.toml"
    residuals: str = "residuals.csv"


FILES = _Files()


@dataclass(frozen=True, slots=True, kw_only=True)
class DiagnosisFiles:
    """A diagnosis of a table from a ``source``, with its answer."""

    found: "Diagnosis"
    table: "Measurements"
    answer: dict[str, Any]
    source: str
    virtual: bool

    def of_stretch(
        self, name: str, found: "Diagnosis", table: "Measurements", folder: Path
    ) -> "DiagnosisFiles":
        """The same of one stretch of a campaign in which something changed on the way, for a folder of its own."""
        answer = answer_of(found, table, None, str(folder / FILES.model))
        return replace(
            self, found=found, table=table, answer=answer, source=f"{self.source}, {name} the change"
        )

    @property
    def as_json(self) -> str:
        """The answer as text."""
        return json.dumps(self.answer, indent=1, allow_nan=False, default=float)

    def write(self, folder: Path) -> None:
        """All files, to a folder that is made where it is missing."""
        folder.mkdir(parents=True, exist_ok=True)
        rests = rests_on(self.answer, self.table.frame, self.source)
        write_model(folder / FILES.model, self.found.extended, rests)
        write_whole(folder / FILES.answer, self.as_json)
        residuals = self.found.residual_table()
        residuals.insert(0, "row", self.table.rows)
        write_table(residuals, folder / FILES.residuals)
        page = DiagnosisPage(
            source=self.source,
            virtual=self.virtual,
            created=f"{datetime.now():%Y-%m-%d %H:%M}",
            diagnosis=self.answer,
            residuals=residuals,
        )
        write_diagnosis_page(folder / FILES.page, page)
