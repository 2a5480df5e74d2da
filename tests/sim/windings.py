"""Converters whose windings' resistance rises with the square of frequency to whatever harmonic."""

from dataclasses import replace

from sim.parameters import Converter

NOWHERE = 1e15  # a harmonic


def never_flattening(converter: Converter) -> Converter:
    """The same with such windings: what lies at the very edge of what can be carried stays there."""
    inductor, transformer = (
        replace(part, winding=replace(part.winding, flattens_at_harmonic=NOWHERE))
        for part in (converter.inductor, converter.transformer)
    )
    return replace(converter, inductor=inductor, transformer=transformer)
