"""Integrals of a decay against quadrature, from no decay at all to a long one."""

import numpy as np
import pytest

from sim.decay import Decay, decay_integral

X = np.array([0.0, 1e-12, 1e-6, 1e-3, 0.03, 0.0999, 0.1001, 0.5, 3.0, 40.0])
NODES, WEIGHTS = np.polynomial.legendre.leggauss(60)
S, W = 0.5 * (NODES + 1.0), 0.5 * WEIGHTS  # Gauss-Legendre on [0, 1]: exact to rounding for these functions


def rise(x: np.ndarray) -> np.ndarray:
    """(1 - e^(-x s)) / x at the nodes, s at x = 0."""
    safe = np.where(x == 0, 1.0, x)[:, None]
    return np.where(x[:, None] == 0, S, -np.expm1(-safe * S) / safe)


FORMS = {
    "integral": (decay_integral, np.exp(-X[:, None] * S) @ W),
    "first": (lambda x: Decay.of(x).first, np.exp(-X[:, None] * S) @ W),
    "moment": (lambda x: Decay.of(x).second, rise(X) @ W),
    "twice": (lambda x: Decay.of(x).twice(), decay_integral(2 * X)),
    "ramp": (lambda x: Decay.of(x).ramp(), (S * rise(X)) @ W),
    "square": (lambda x: Decay.of(x).square(), rise(X) ** 2 @ W),
}


@pytest.mark.parametrize("name", FORMS)
def test_it_is_the_integral_down_to_nothing(name: str) -> None:
    ours, quadrature = FORMS[name]
    each = np.concatenate([ours(X[k : k + 1]) for k in range(X.size)])
    # closed forms start at 0.1, where they subtract numbers that agree in two digits
    np.testing.assert_allclose(each, quadrature, rtol=1e-13)


@pytest.mark.parametrize("name", FORMS)
def test_a_mixed_array_is_as_its_elements(name: str) -> None:
    function, _ = FORMS[name]
    alone = np.concatenate([function(X[k : k + 1]) for k in range(X.size)])
    np.testing.assert_allclose(function(X), alone, rtol=1e-15)  # the last digit
