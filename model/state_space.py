"""A machine, its mechanics and a discretisation make a discrete state-space model f, h, F, H."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca

from model.drive import Drive
from model.machines import MACHINES, Machine
from model.machines.base import Named, Parameters, Rotor
from model.mechanics import MECHANICS, Mechanics
from model.quantities import Constant, Constants, Quantity

INPUTS = (
    Quantity("v_alpha", r"v_\alpha", "V", "stator voltage, alpha axis, mean over the interval ending now"),
    Quantity("v_beta", r"v_\beta", "V", "stator voltage, beta axis, mean over the interval ending now"),
)
OUTPUTS = (
    Quantity("i_alpha", r"i_\alpha", "A", "measured stator current, alpha axis, now"),
    Quantity("i_beta", r"i_\beta", "A", "measured stator current, beta axis, now"),
)


@dataclass(frozen=True)
class StateSpaceModel:
    """x' = f(x, u), y = h(x), symbolic.

    ``propagate`` and ``measure`` may be called at any symbolic point and give the value (a list of
    scalars) with the named intermediates; ``f, h, F, H`` are their values and Jacobians at ``x, u``.
    """

    machine: Machine
    mechanics: Mechanics
    discretization: str
    _constants: Constants

    @property
    def states(self) -> tuple[Quantity, ...]:
        return self.machine.states + self.mechanics.states

    @property
    def angle(self) -> int:
        """Index of the one state that lives on a circle, theta."""
        return [state.name for state in self.states].index("theta")

    @property
    def constants(self) -> list[Constant]:
        """The folded constants that f and h use, in order of appearance."""
        _ = self.f, self.h
        return list(self._constants.items.values())

    def numeric(self, expression: Any) -> Any:
        """``expression`` with the folded constants' symbols replaced by their numbers."""
        return self._constants.numeric(expression)

    @property
    def exact_meaning(self) -> str:
        return self.machine.exact_meaning

    def propagate(self, x: list[Any], u: list[Any]) -> tuple[list[Any], Named]:
        """f: the state one sample later, eq. 6 and 7."""
        omega_e = self.mechanics.electrical_speed(x[2])
        sample = self.machine.euler if self.discretization == "euler" else self.machine.exact
        advance = self.mechanics.euler if self.discretization == "euler" else self.mechanics.exact
        electrical = sample((x[0], x[1]), (u[0], u[1]), omega_e, x[3])
        mechanical, named = advance(x[2:], omega_e, lambda: self.machine.torque(*electrical.torque_at))
        if "torque" in named and self.discretization != "euler":  # then it is taken between two samples
            between = {f"{s.name}_mid": z for s, z in zip(self.machine.states, electrical.torque_at[0], strict=True)}
            named = {**between, **named}
        return [*electrical.z, *mechanical], {"omega_e": omega_e, **electrical.named, **named}

    def measure(self, x: list[Any]) -> tuple[list[Any], Named]:
        """h: the currents, eq. 5."""
        i, named = self.machine.currents((x[0], x[1]), Rotor.at(x[3]))
        return list(i), named

    def measurement_jacobian(self, x: list[Any]) -> Any:
        """H at the point ``x``, an SX of shape (2, n)."""
        return ca.substitute(self.H, self.x, ca.vertcat(*x))

    @cached_property
    def x(self) -> Any:
        return ca.vertcat(*(ca.SX.sym(state.name) for state in self.states))

    @cached_property
    def u(self) -> Any:
        return ca.vertcat(*(ca.SX.sym(quantity.name) for quantity in INPUTS))

    @cached_property
    def f(self) -> Any:
        return ca.vertcat(*self.propagate(ca.vertsplit(self.x), ca.vertsplit(self.u))[0])

    @cached_property
    def h(self) -> Any:
        return ca.vertcat(*self.measure(ca.vertsplit(self.x))[0])

    @cached_property
    def F(self) -> Any:
        """df/dx, (n, n)."""
        return ca.jacobian(self.f, self.x)

    @cached_property
    def H(self) -> Any:
        """dh/dx, (2, n): the measurement Jacobian."""
        return ca.jacobian(self.h, self.x)


def build(drive: Drive, parameters: Parameters | None = None) -> StateSpaceModel:
    """The discrete model of a drive.

    Parameters
    ----------
    drive : Drive
        Which machine, mechanics and discretisation.
    parameters : Parameters, optional
        Defaults to the drive's numbers; pass ``Parameters.symbolic()`` to derive with letters.
    """
    constants = Constants(named=parameters is None)
    parameters = parameters or Parameters.numeric(drive)
    machine = MACHINES[drive.model.machine](parameters, constants)
    mechanics = MECHANICS[drive.model.mechanics](parameters, constants)
    return StateSpaceModel(machine, mechanics, drive.model.discretization, constants)


def default_initial_state(drive: Drive) -> list[float]:
    """Standstill, angle 0, no current (flux states then hold the magnet's flux), unless the drive file differs."""
    if drive.filter.initial_state is not None:
        return list(drive.filter.initial_state)
    machine = MACHINES[drive.model.machine](Parameters.numeric(drive), Constants(named=False))
    z = machine.electrical_state((ca.SX(0), ca.SX(0)), Rotor.at(ca.SX(0)))
    return [float(z[0]), float(z[1])] + [0.0] * len(MECHANICS[drive.model.mechanics].states)
