"""A machine, its mechanics and a discretisation make a discrete state-space model f, h, F, H."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca

from model.machines import Machine, find_machine
from model.machines.adaptive import Adaptive
from model.machines.base import Named, Parameters, Rotor
from model.machines.mechanics import MECHANICS, Mechanics
from model.machines.tolerance import WrongData, deviations
from model.quantities import Constant, Constants, Formulas, Quantity
from model.schema import Drive

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
    adaptive: Adaptive
    _constants: Constants
    root_order: tuple[str, ...] = ()
    wrong: WrongData | None = None

    @property
    def states(self) -> tuple[Quantity, ...]:
        """Names and units of the states, in order."""
        return self.machine.states + self.mechanics.states + self.adaptive.states

    @property
    def angle(self) -> int:
        """Index of the one state that lives on a circle, theta."""
        return [state.name for state in self.states].index("theta")

    @property
    def order(self) -> tuple[int, ...]:
        """The states, by index, in the order in which P is factored: row k of a factor is that of state order[k].

        Any S with S S^T = P is a square root (eq. 13); another order of the states gives another one, other points, and
        so another filter of the same kind. The paper's is the order of the state.
        """
        names = [state.name for state in self.states]
        return tuple(names.index(name) for name in self.root_order or names)

    @property
    def constants(self) -> list[Constant]:
        """The folded constants that f, h and G use, in order of appearance."""
        _ = self.f, self.h, self.G
        return list(self._constants.items.values())

    def numeric(self, expression: Any) -> Any:
        """``expression`` with the folded constants' symbols replaced by their numbers.

        Parameters
        ----------
        expression : object
            A CasADi expression.
        """
        return self._constants.numeric(expression)

    @property
    def exact_meaning(self) -> str:
        """The meaning of "exact" for this machine, in words."""
        return self.machine.exact_meaning

    def propagate(self, x: list[Any], u: list[Any]) -> tuple[list[Any], Named]:
        """f: the state one sample later, eq. 6 and 7.

        Parameters
        ----------
        x : list of Any
            State, in the model's order.
        u : list of Any
            Mean voltage over the interval, V.
        """
        machine, moving, slow = self._machine_at(x), *self._mechanical(x)
        omega_e = self.mechanics.electrical_speed(x[2])
        sample = machine.euler if self.discretization == "euler" else machine.exact
        advance = self.mechanics.euler if self.discretization == "euler" else self.mechanics.exact
        electrical = sample((x[0], x[1]), (u[0], u[1]), omega_e, x[3])
        mechanical, named = advance(moving, omega_e, lambda: machine.rotor_torque(*electrical.torque_at))
        if "torque" in named and self.discretization != "euler":  # then it is taken between two samples
            axes = [f"{machine.states[0].name.removesuffix('alpha')}{axis}_between" for axis in "dq"]
            between = dict(zip(axes, electrical.torque_at[0], strict=True))
            named = {**between, **named}
        return [*electrical.z, *mechanical, *self.adaptive.advance(slow)], {
            "omega_e": omega_e,
            **electrical.named,
            **named,
        }

    def measure(self, x: list[Any]) -> tuple[list[Any], Named]:
        """h: the currents, eq. 5.

        Parameters
        ----------
        x : list of Any
            State, in the model's order.
        """
        i, named = self._machine_at(x).currents((x[0], x[1]), Rotor.at(x[3]))
        return list(i), named

    def _mechanical(self, x: list[Any]) -> tuple[list[Any], list[Any]]:
        """The mechanics' part of the state, and the adaptive part."""
        end = 2 + len(self.mechanics.states)
        return x[2:end], x[end:]

    def _machine_at(self, x: list[Any]) -> Machine:
        """The machine, its adaptive parameters taken from the state."""
        if not self.adaptive.words:
            return self.machine
        par = self.adaptive.parameters(self._mechanical(x)[1])
        return type(self.machine)(par, self._constants, self.machine.par)

    def measurement_jacobian(self, x: list[Any]) -> Any:
        """H at the point ``x``, an SX of shape (2, n).

        Parameters
        ----------
        x : list of Any
            State, in the model's order.
        """
        return ca.substitute(self.H, self.x, ca.vertcat(*x))

    @cached_property
    def x(self) -> Any:
        """The state, an SX column of symbols."""
        return ca.vertcat(*(ca.SX.sym(state.name) for state in self.states))

    @cached_property
    def u(self) -> Any:
        """The inputs v_alpha, v_beta (V), an SX column of symbols."""
        return ca.vertcat(*(ca.SX.sym(quantity.name) for quantity in INPUTS))

    @cached_property
    def f(self) -> Any:
        """f(x, u), an SX column."""
        return ca.vertcat(*self.propagate(ca.vertsplit(self.x), ca.vertsplit(self.u))[0])

    @cached_property
    def h(self) -> Any:
        """h(x), an SX column."""
        return ca.vertcat(*self.measure(ca.vertsplit(self.x))[0])

    @cached_property
    def G(self) -> dict[str, Any]:
        """For each datum that may be wrong, by its letter, its deviation times df/dp: an SX column of x and u."""
        if self.wrong is None:
            return {}
        _ = self.f, self.h  # whose constants come first
        f = ca.vertcat(*self.wrong.propagate(ca.vertsplit(self.x), ca.vertsplit(self.u))[0])
        return self.wrong.columns(f, self._constants)

    @cached_property
    def F(self) -> Any:
        """df/dx, (n, n)."""
        return ca.jacobian(self.f, self.x)

    @cached_property
    def H(self) -> Any:
        """dh/dx, (2, n): the measurement Jacobian."""
        return ca.jacobian(self.h, self.x)


def build(drive: Drive, parameters: Parameters | None = None, constants: Constants | None = None) -> StateSpaceModel:
    """The discrete model of a drive.

    Parameters
    ----------
    drive : Drive
        Which machine, mechanics and discretisation.
    parameters : Parameters, optional
        Defaults to the drive's numbers; pass ``Parameters.symbolic()`` to derive with letters.
    constants : Constants, optional
        Collects what is folded. By default constants have names if the parameters are numbers, and are written out
        otherwise.
    """
    wrong = _wrong_data(drive) if parameters is None else None
    constants = constants or Constants(named=parameters is None)
    parameters = parameters or Parameters.numeric(drive)
    machine = find_machine(drive)(parameters, constants)
    mechanics = MECHANICS[drive.model.mechanics](parameters, constants)
    model = drive.model
    adaptive = Adaptive(tuple(model.adaptive), model.return_rate, parameters, constants)
    order = tuple(drive.filter.root_order or ())
    return StateSpaceModel(machine, mechanics, model.discretization, adaptive, constants, order, wrong)


def _wrong_data(drive: Drive) -> WrongData | None:
    """The drive's model once more, with letters for the data that may be wrong, if there are any."""
    relative = deviations(drive)
    if not relative:
        return None
    known = Parameters.numeric(drive)
    letters = {name: ca.SX.sym(name) for name in relative}
    formulas = Formulas(letters.values())
    lettered = build(drive, replace(known, **letters), formulas)
    listed = tuple((letters[name], float(getattr(known, name)), relative[name]) for name in relative)
    return WrongData(listed, lettered.propagate, formulas)


def default_initial_state(drive: Drive) -> list[float]:
    """Standstill, angle 0, no current (flux states then hold the magnet's flux), the motor's data for adaptive states.

    Unless the drive file says otherwise.

    Parameters
    ----------
    drive : Drive
        If it has a ``filter.initial_state``, that is the answer.

    Returns
    -------
    list of n floats
        In the order and units of the model's states.
    """
    if drive.filter.initial_state is not None:
        return list(drive.filter.initial_state)
    machine = find_machine(drive)(Parameters.numeric(drive), Constants(named=False))
    z = machine.electrical_state((ca.SX(0), ca.SX(0)), Rotor.at(ca.SX(0)))
    slow = [getattr(drive.motor, word) for word in drive.model.adaptive]
    return [float(z[0]), float(z[1])] + [0.0] * len(MECHANICS[drive.model.mechanics].states) + slow
