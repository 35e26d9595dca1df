"""Along which states h is affine, and that an iterate may ask h where those are predicted."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from codegen.fast.affine import affine_states
from model.drives.load import load_drive, shipped_drives
from model.machines.state_space import build

pytestmark = pytest.mark.unit


class Measured(SimpleNamespace):
    """A model as far as it is asked: a state and what is measured of it."""

    __hash__ = object.__hash__

    @staticmethod
    def numeric(expression: Any) -> Any:
        return expression


def named(drive: str) -> set[str]:
    model = build(load_drive(drive))
    return {model.states[i].name for i in affine_states(model)}


def test_flux_states_are_affine_and_the_angle_is_not() -> None:
    assert named("ipmsm_flux") == {"psi_alpha", "psi_beta", "omega"}
    others = {"omega", "load_torque", "magnet_flux", "stator_resistance"}
    assert named("ipmsm_adaptive") == {"psi_alpha", "psi_beta", *others}
    assert "theta" in named("ipmsm"), "its currents are measured: h is linear"


@pytest.mark.parametrize("name", shipped_drives())
def test_the_identity(name: str) -> None:
    """h(x) + H(x) (p - x) = h(p in what is affine, x in the rest) + H(x) (p - x) in the rest, at random points."""
    model = build(load_drive(name))
    h = ca.Function("h", [model.x], [model.numeric(model.h), model.numeric(ca.densify(model.H))])
    chosen = np.isin(np.arange(len(model.states)), list(affine_states(model)))
    rng = np.random.default_rng(2)
    for _ in range(5):
        x, p = rng.normal(size=(2, len(model.states)))
        value, H = (np.array(part) for part in h(x))
        mixed = np.array(h(np.where(chosen, p, x))[0]).ravel()
        expected = value.ravel() + H @ (p - x)
        np.testing.assert_allclose(mixed + H @ np.where(chosen, 0.0, p - x), expected, rtol=1e-10, atol=1e-9)


def test_factors_and_kinks() -> None:
    """Of two factors one is taken; where h has a kink none is, though every second derivative is zero there."""
    x = ca.SX.sym("x", 4)
    product = Measured(x=x, h=ca.vertcat(x[0] * x[1] + x[2], ca.sin(x[3]) * x[1]))
    assert affine_states(product) == {0, 2}  # type: ignore[arg-type]
    kink = Measured(x=x, h=ca.vertcat(ca.fmax(x[0], 0), x[1]))
    assert affine_states(kink) == frozenset()  # type: ignore[arg-type]
