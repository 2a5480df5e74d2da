r"""Everyday spreads of parts that one effect changes together: what they have in common, and how they differ.

An effect on several parts takes the place of what their spreads have in common; how the parts differ from each other is
everyday all the same. With z the parts' spreads in sigmas and d what the effect moves each by, the common one is
:math:`d^T z / \|d\|`, and those at right angles to it are the differences. All are independent and of one sigma, as the
parts themselves are: the axes are turned, and nothing else.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sim.effects.base import Effect
from sim.effects.catalogue import CATALOGUE
from sim.effects.parameter_effect import ParameterEffect
from sim.parameters import Converter
from sim.spread import Spread

Array = NDArray[np.float64]

_BESIDE = " beside "
_STEP = 0.01  # of an effect's prior scale: parts go along


@dataclass(frozen=True, slots=True, kw_only=True)
class CommonModes:
    """The spreads of K parts, and the names and directions (K, K) of their axes, orthonormal, in sigmas of the parts.

    An axis that is common to the parts of an effect has the effect's name, every other that of its part. What is none
    at all, as the recovered charge of a Schottky diode, is no part. ``elsewhere`` are parts that an effect would change
    in another converter: an IGBT's resistance, where it changes that of FETs.
    """

    spreads: tuple[Spread, ...]
    names: tuple[str, ...]
    axes: Array
    elsewhere: frozenset[str] = frozenset()

    @classmethod
    def of(cls, spreads: tuple[Spread, ...], converter: Converter) -> Self:
        """For the spreads of a converter's parts."""
        names, axes = [s.path for s in spreads], np.eye(len(spreads))
        place = {s.path: k for k, s in enumerate(spreads)}
        elsewhere = set[str]()
        for name, entry in CATALOGUE.items():
            if not isinstance(entry, ParameterEffect) or entry.replaces:
                continue
            present = entry.present(converter)
            elsewhere |= {path for path in entry.paths if path in place and path not in present}
            paths = [path for path in present if path in place and _value(converter, path) != 0.0]
            own = [place[path] for path in paths]
            if len(own) < 2:
                continue
            axes[np.ix_(own, own)] = _turned_to(_moved(entry, converter, [spreads[k] for k in own]))
            names[own[0]] = name
            for k in own[1:]:
                names[k] = spreads[k].path + _BESIDE + spreads[own[0]].path
        return cls(spreads=spreads, names=tuple(names), axes=axes, elsewhere=frozenset(elsewhere))

    def __len__(self) -> int:
        return len(self.spreads)

    def differences(self, effect: str) -> NDArray[np.intp]:
        """The axes along which the parts of an effect differ, none where it has but one."""
        if effect not in self.names:
            return np.empty(0, dtype=np.intp)
        beside = _BESIDE + self.spreads[self.names.index(effect)].path
        return np.array([k for k, name in enumerate(self.names) if name.endswith(beside)], dtype=np.intp)

    def along(self, parts: Array) -> Array:
        """Parts (..., K) that are off by so many sigmas, along the axes."""
        return np.asarray(parts @ self.axes.T)

    def parts(self, along: Array) -> Array:
        """What is off along the axes (..., K), in sigmas of the parts."""
        return np.asarray(along @ self.axes)


def _moved(entry: Effect, converter: Converter, parts: Sequence[Spread]) -> Array:
    """What a small step of an effect moves each part by, in the part's sigmas."""
    head = entry.headline
    there = entry.converter(converter, {head.name: head.off + _STEP * head.prior})
    moved = []
    for part in parts:
        before = _value(converter, part.path)
        moved.append((_value(there, part.path) - before) / (part.moved(before, 1.0) - before))
    return np.array(moved)


def _value(converter: Converter, path: str) -> float:
    return float(attrgetter(path)(converter))


def _turned_to(direction: Array) -> Array:
    """Orthonormal axes (n, n), the first along a direction: Householder's reflection."""
    first = direction / np.linalg.norm(direction)
    mirror = first - np.eye(first.size)[0]
    return np.asarray(np.eye(first.size) - 2.0 * np.outer(mirror, mirror) / (mirror @ mirror))
