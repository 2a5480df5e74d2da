"""Who answered: maker, model, serial number and firmware, as the instrument itself tells them."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Identity:
    """One instrument's own words about itself; a field it does not tell is an empty string."""

    maker: str
    model: str
    serial: str
    firmware: str

    def __str__(self) -> str:
        return " ".join(part for part in (self.maker, self.model) if part)
