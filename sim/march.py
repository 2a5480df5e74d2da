r"""The link current over half a period, in closed form, from given instants at which the bridges step.

Between two steps of a bridge the link obeys

.. math:: L \, \dot\imath = v_p - n v_s - \sigma V_0 - R \, (i + \tau \dot\imath) - \sigma' V_0' + R' i_m, \qquad
          \sigma = \operatorname{sign} i, \quad \sigma' = \operatorname{sign} (i - i_m)

with the drops of whatever conducts: V0 of the primary's active state with the current along or against the voltage, or
of its zero state, V0' of the secondary's; R is all resistance, R' what of it is the secondary's. A resistor L / tau
beside the inductance carries tau di/dt: the windings' eddy currents, whose resistance rises with frequency squared.
What leaves the bridges' terminals is i + tau di/dt. Each stretch is solved by its exponential, cut where i crosses zero
or, with a threshold in the secondary, the magnetizing current. A current that the remaining voltage cannot lift over
its threshold stays there. Points are followed one by one (:mod:`sim.stretches`).

The magnetizing current is a triangle of its own, driven by n vs. With rho = R'/R the part y = i - rho i_m is an
exponential, and i that and a straight line.

Assumption: the transformer's windings carry the link current, and the secondary's drop is left out of what drives the
magnetizing current's triangle; its power is not (:meth:`sim.pieces.Pieces.bridge_energy`).
"""

import numpy as np
from numpy.typing import NDArray

from sim.pieces import Pieces
from sim.waveform import Circuit, Steps

Array = NDArray[np.float64]


def march(circuit: Circuit, steps: Steps, start_A: Array) -> Pieces:
    """Follow the current through a half period; within a stretch a piece ends where the current bends or is zero."""
    # here: compiled code takes a while to load
    from sim.stretches import BEHIND_OHM, BEHIND_SIGN, BEHIND_V, MEETS, OF_ALL, follow

    magnetizing, rises = steps.magnetizing(circuit)
    stretches = np.stack([steps.duration_s, steps.vp_V, steps.nvs_V, magnetizing, rises])
    own, bends_A = circuit.secondary is not None, circuit.bends_A
    kept = follow(_given(circuit), stretches, start_A, bends_A, own)
    length, current, drive, decay, sign, relative, share, shunt = kept[:OF_ALL]
    each = len(length) // 5
    return Pieces(
        start_s=np.concatenate([np.zeros_like(length[:1]), np.cumsum(length, axis=0)[:-1]]), duration_s=length,
        current_A=current, drive_A_per_s=drive, decay_per_s=decay, sign=sign, relative_L=relative, share=share,
        magnetizing_A=shunt, vp_V=np.repeat(steps.vp_V, each, axis=0), nvs_V=np.repeat(steps.nvs_V, each, axis=0),
        magnetizing_A_per_s=np.repeat(rises, each, axis=0), eddy_s=circuit.eddy_s,
        behind_Ohm=kept[BEHIND_OHM] if own else circuit.behind_Ohm,
        behind_V=kept[BEHIND_V] if own else 0.0,
        secondary_sign=kept[BEHIND_SIGN] if own else None,
        meets_A_per_s=kept[MEETS] if own else 0.0,
    )  # fmt: skip


def _given(circuit: Circuit) -> Array:
    """What of the circuit the pieces depend on, in the rows of :mod:`sim.stretches`, (S, N)."""
    shape = circuit.V1_V.shape
    values = (
        circuit.V1_V, circuit.nV2_V, circuit.inductance_H, circuit.half_period_s, circuit.dead_time_s,
        np.broadcast_to(circuit.eddy_s, shape), np.broadcast_to(circuit.behind_Ohm, shape),
    )  # fmt: skip
    secondary = np.zeros((6, *shape)) if circuit.secondary is None else circuit.secondary.reshape(6, -1)
    relative = circuit.relative_L if circuit.bends_A.size else np.ones((1, *shape))
    return np.concatenate([values, circuit.forward, circuit.reverse, circuit.zero, secondary, relative])
