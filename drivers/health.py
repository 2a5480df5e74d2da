"""How well a link does: exchanges, and those that failed."""

from dataclasses import dataclass


@dataclass(slots=True)
class Health:
    """Counts of one link since it was opened."""

    exchanges: int = 0
    failures: int = 0
    last_error: str = ""

    def failed(self, error: Exception) -> None:
        """An exchange went wrong."""
        self.failures += 1
        self.last_error = str(error)
