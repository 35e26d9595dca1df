"""A machine, its mechanics and a discretisation make a discrete state-space model f, h, F, H."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca

from model.inverter import STATE, takes_voltage
from model.machines import Machine, find_machine
from model.machines.adaptive import Adaptive, own_value
from model.machines.base import Named, Parameters, Rotor, Sampled
from model.machines.lost_voltage import LostVoltage, constant_voltage
from model.machines.mechanics import MECHANICS, Mechanics
from model.machines.tolerance import WrongData, WrongVoltage, deviations, half_widths, wrong_voltage
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


#: What f takes where V_d is a state or may be wrong: the direction in which it acts.
SIGNS = (
    Quantity("g_alpha", r"g_\alpha", "1", "direction in which V_d acts, alpha axis"),
    Quantity("g_beta", r"g_\beta", "1", "direction in which V_d acts, beta axis"),
)
#: And beside it, where V_d may be wrong.
UNSURE = Quantity("unsure", r"\varsigma", "1", "0 where all legs' signs are whole, 1 where no current flows")


@dataclass(frozen=True)
class StateSpaceModel:
    """x' = f(x, v), y = h(x), symbolic; v is the voltage applied.

    ``lost`` says what of a commanded u that is (:mod:`model.machines.lost_voltage`); None: all of it.

    ``propagate`` and ``measure`` may be called at any symbolic point and give the value (a list of
    scalars) with the named intermediates; ``f, h, F, H`` are their values and Jacobians at ``x, u``.
    """

    machine: Machine
    mechanics: Mechanics
    discretization: str
    adaptive: Adaptive
    _constants: Constants
    root_order: tuple[str, ...] = ()
    lost: LostVoltage | None = None
    wrong: WrongData | None = None
    doubt: WrongVoltage | None = None  # V, of V_d where that is a constant: the deviation that counts in a sample

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
        """The folded constants that h, bounds, f and G use, in order of appearance."""
        _ = self._users_of_constants
        return list(self._constants.items.values())

    @cached_property
    def _users_of_constants(self) -> tuple[Any, ...]:
        return self.h, self.kept(ca.vertsplit(self.x)), self.f_commanded, self.G

    def numeric(self, expression: Any) -> Any:
        """``expression`` with the folded constants' symbols replaced by their numbers.

        Parameters
        ----------
        expression : SX
        """
        return self._constants.numeric(expression)

    @property
    def exact_meaning(self) -> str:
        """The meaning of "exact" for this machine, in words."""
        return self.machine.exact_meaning

    @property
    def inputs(self) -> dict[str, tuple[Quantity, ...]]:
        """What f takes beside the state, by the names its arrays have in a step.

        ``u`` is the voltage as commanded, ``v`` the one applied. Where V_d is a state each point has its own: f takes
        it off v times the direction ``g``, which the points share. Where V_d may be wrong, G alone hangs on g, whose
        third entry says how unsure the first two are.
        """
        if self.lost is None:
            return {"u": INPUTS}
        if self.doubt:
            return {"v": INPUTS, "g": (*SIGNS, UNSURE)}
        return {"v": INPUTS, "g": SIGNS} if self.estimates_voltage else {"v": INPUTS}

    @property
    def estimates_voltage(self) -> bool:
        """Whether V_d is a state."""
        return STATE in self.adaptive.words

    def applied(self, x: list[Any], u: list[Any]) -> tuple[dict[str, tuple[Any, ...]], Named]:
        """What f takes for a commanded voltage where the state is x, its arrays by name.

        The signs are those of the current the filter believes in at the beginning of the interval: one point's, not
        each point's own. They jump where a current passes zero, so that a spread of points about a jump says little of
        what they do, and they do not turn with the stator frame as the motor does.

        Where V_d is a state, g is only as long as V_d shows (:meth:`LostVoltage.seen`); the rest is taken off at the
        estimate's V_d, which no point moves.

        Parameters
        ----------
        x : list of Any
            State, in the model's order: an estimate.
        u : list of Any
            Mean voltage over the interval as commanded, V.
        """
        commanded = u[0], u[1]
        if self.lost is None:
            return {"u": commanded}, {}
        i, named = self.measure(x)
        if named:  # the currents are no states
            named = {**named, "i_alpha": i[0], "i_beta": i[1]}
        g, signs = self.lost.signs(i)
        if not self.estimates_voltage:
            V_d = constant_voltage(self._constants, self.lost.par.V_d)
            remaining = {"v": self.lost.remaining(commanded, g, V_d)}
            if self.doubt:
                return {**remaining, "g": (*g, self.lost.unsure(list(signs.values())))}, {**named, **signs}
            return remaining, {**named, **signs, "g_alpha": g[0], "g_beta": g[1]}
        seen = self.lost.seen(i)
        named |= {**signs, "whole_alpha": g[0], "whole_beta": g[1], "seen": seen}
        hidden = (1 - seen) * self._voltage(x)
        return {"v": self.lost.remaining(commanded, g, hidden), "g": (seen * g[0], seen * g[1])}, named

    def _voltage(self, x: list[Any]) -> Any:
        """V_d, the state."""
        return self._mechanical(x)[1][self.adaptive.words.index(STATE)]

    def propagate(self, x: list[Any], u: list[Any], g: list[Any] | None = None) -> tuple[list[Any], Named]:
        """f: the state one sample later, eq. 6 and 7.

        Parameters
        ----------
        x : list of Any
            State, in the model's order.
        u : list of Any
            Mean voltage over the interval, V: the one applied, or what ``g`` takes V_d, a state, off.
        g : list of Any, optional
            The direction in which V_d acts.
        """
        if self.lost is not None and g is not None and self.estimates_voltage:
            u = list(self.lost.remaining((u[0], u[1]), (g[0], g[1]), self._voltage(x)))
        machine, moving, slow = self._machine_at(x), *self._mechanical(x)
        omega_e = self.mechanics.electrical_speed(x[2])
        advance = self.mechanics.euler if self.discretization == "euler" else self.mechanics.exact
        electrical = self._sampled(machine, x, u, omega_e)
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

    def _sampled(self, machine: Machine, x: list[Any], v: list[Any], omega_e: Any) -> Sampled:
        """The electrical side of a sample."""
        sample = machine.euler if self.discretization == "euler" else machine.exact
        return sample((x[0], x[1]), (v[0], v[1]), omega_e, x[3])

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

    def kept(self, x: list[Any]) -> list[Any]:
        """An estimate as it is kept for the next sample.

        Adaptive states lie within their tolerance (:meth:`Adaptive.within`). The step wraps theta at its end
        (:func:`model.filters.program.wrap_angle`), since float32 loses digits of an angle that is let grow.

        Parameters
        ----------
        x : list of Any
            State, in the model's order.
        """
        slow = len(self.adaptive.words)
        return [*x[: len(x) - slow], *self.adaptive.within(x[len(x) - slow :])]

    @property
    def kept_meaning(self) -> str:
        """What :meth:`kept` does, in words."""
        return "adaptive states within their tolerance" if any(self.adaptive.half_widths) else ""

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
        """The commanded v_alpha, v_beta (V), an SX column of symbols."""
        return ca.vertcat(*(ca.SX.sym(quantity.name) for quantity in INPUTS))

    @cached_property
    def arguments(self) -> list[Any]:
        """What f takes: the state, then an SX column of symbols for each of ``inputs``."""
        columns = {name: ca.vertcat(*(ca.SX.sym(q.name) for q in entries)) for name, entries in self.inputs.items()}
        return [self.x, *({**columns, "u": self.u}[name] for name in columns)]

    @cached_property
    def f(self) -> Any:
        """f of :attr:`arguments`, an SX column."""
        return ca.vertcat(*self.propagate(*(ca.vertsplit(column) for column in self.arguments))[0])

    @cached_property
    def f_commanded(self) -> Any:
        """The state one sample after x under a commanded voltage u, an SX column of both alone."""
        x, u = ca.vertsplit(self.x), ca.vertsplit(self.u)
        return ca.vertcat(*self.propagate(x, *map(list, self.applied(x, u)[0].values()))[0])

    @cached_property
    def h(self) -> Any:
        """h(x), an SX column."""
        return ca.vertcat(*self.measure(ca.vertsplit(self.x))[0])

    @cached_property
    def G(self) -> dict[str, Any]:
        """Its deviation times df/dp of each datum that may be wrong, by its letter: SX columns of ``arguments``."""
        _ = self.f_commanded, self.h  # whose constants come first
        columns: dict[str, Any] = {}
        if self.wrong is not None:
            f = ca.vertcat(*self.wrong.propagate(*map(ca.vertsplit, self.arguments))[0])
            columns = self.wrong.columns(f, self._constants, self.flux_slopes)
        if self.doubt:
            assert self.lost is not None
            sigma = self._constants("SIGMA_V_D", ca.SX(self.doubt.of_size), "one sigma of V_d, V")
            loss = self.doubt.of_signs * self.lost.par.V_d
            noise = self._constants("SIGMA_LOSS", loss, "V: one sigma of either axis where no sign is sure")
            noise = noise * self.arguments[2][2]
            sigmas = {"V_d": sigma, "loss_along": noise, "loss_across": noise}
            columns |= {letter: sigmas[letter] * slope for letter, slope in self.voltage_slopes.items()}
        return columns

    @property
    def flux_slopes(self) -> dict[str, Any]:
        """What f lacks per unit of a datum that h has wrong (:meth:`Machine.lacking`): SX columns of ``arguments``."""
        x = ca.vertsplit(self.x)
        speed = self.mechanics.electrical_speed(x[2])
        lacking = self._machine_at(x).lacking((x[0], x[1]), speed, Rotor.at(x[3]))
        moving, slow = self._mechanical(x)
        advance = self.mechanics.euler if self.discretization == "euler" else self.mechanics.exact
        T_e = ca.SX.sym("torque")
        by_torque = ca.jacobian(ca.vertcat(*advance(moving, speed, lambda: T_e)[0], *slow), T_e)
        return {letter: ca.vertcat(*z, torque * by_torque) for letter, (z, torque) in lacking.items()}

    @property
    def torque_rotor(self) -> Rotor:
        """Where f has its torque."""
        x, v = ca.vertsplit(self.x), ca.vertsplit(self.arguments[1])
        return self._sampled(self._machine_at(x), x, v, self.mechanics.electrical_speed(x[2])).torque_at[1]

    @property
    def voltage_slopes(self) -> dict[str, Any]:
        """How f moves with what an inverter of a known V_d leaves unsure, by its letter: SX columns of ``arguments``.

        With V_d, which acts against g; with a volt along the rotor's axis, and across it, where f has its torque. Both
        together are any volt of one size; on these axes each turns with the stator frame, too.
        """
        v, g = self.arguments[1:]
        rotor = self.torque_rotor
        axes = {"loss_along": rotor.to_stator((1.0, 0.0)), "loss_across": rotor.to_stator((0.0, 1.0))}
        ways = {"V_d": -g[:2]} | {letter: ca.vertcat(*axis) for letter, axis in axes.items()}
        return {letter: ca.jtimes(self.f, v, way) for letter, way in ways.items()}

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
        Collects what is folded. By default constants have names if the parameters are numbers, else none.
    """
    wrong = _wrong_data(drive) if parameters is None else None
    constants = constants or Constants(named=parameters is None)
    parameters = parameters or Parameters.numeric(drive)
    machine = find_machine(drive)(parameters, constants)
    mechanics = MECHANICS[drive.model.mechanics](parameters, constants)
    model = drive.model
    adaptive = Adaptive(tuple(model.adaptive), model.return_rate, parameters, constants, half_widths(drive))
    order = tuple(drive.filter.root_order or ())
    lost = LostVoltage(parameters, constants) if takes_voltage(drive) else None
    doubt = wrong_voltage(drive)
    return StateSpaceModel(machine, mechanics, model.discretization, adaptive, constants, order, lost, wrong, doubt)


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
    """Standstill, angle 0, no current (flux states then hold the magnet's flux), the drive's data for adaptive states.

    Unless the drive file says otherwise.

    Parameters
    ----------
    drive : Drive
        If it has a ``filter.initial_state``, that is the answer.

    Returns
    -------
    list of n floats
        In the order and units of the model's states; theta in [-pi, pi].
    """
    if drive.filter.initial_state is not None:
        given = list(drive.filter.initial_state)
        return [*given[:3], math.remainder(given[3], 2 * math.pi), *given[4:]]
    machine = find_machine(drive)(Parameters.numeric(drive), Constants(named=False))
    z = machine.electrical_state((ca.SX(0), ca.SX(0)), Rotor.at(ca.SX(0)))
    slow = [own_value(drive, word) for word in drive.model.adaptive]
    return [float(z[0]), float(z[1])] + [0.0] * len(MECHANICS[drive.model.mechanics].states) + slow
