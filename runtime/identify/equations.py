"""The step of an extended Kalman filter with motor data as inputs: what the likelihood of a recording is made of.

f, h and their Jacobians are the drive's own (:mod:`model.machines`), with a letter in the place of every datum. States:
two electrical ones, omega, theta, load torque; and a voltage d (V) that nobody told of, which fades slowly. What is
made of the letters alone (a decay, a gain) is a constant of a parameter set, worked out once by
:attr:`Equations.constants`; the step itself has no exponential.

An inverter takes V_d from a leg twice a period, at its edges, by the sign of the current there. The mean current of a
sample and the ripple, which is smallest where a leg turns on and largest where it turns off, make two signs a leg::

    v = u + d - V_d g,    g = Clarke of (sign(i_on - r) + sign(i_off + r)) / 2,    r = leg's part of ripple Y swing

with ``swing`` (V s, two axes) and the edges' times of a row from u itself (:mod:`runtime.identify.rows`), and Y the
inverse inductance at the rotor's angle, as the machine's own equations have it: of a salient machine the ripple is not
that of one inductance (with (L_d + L_q) / 2 instead, L_q of ``ipmsm_flux`` behind PWM is 0.4 % off in every draw). A
sign fades below I_0, and F is the derivative by way of the signs, too. Process noise of a sample::

    Q = (df/dv)(df/dv)^T (v_noise + v_unsure (1 - mean of the squared signs)) + diag(0, 0, omega_noise, theta_noise,
        torque_noise + step, drift_noise (1 - drift_kept^2) twice)
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import casadi as ca

from model.inverter import clarke, legs
from model.machines import MACHINES
from model.machines.base import Parameters, Rotor
from model.machines.state_space import StateSpaceModel, build
from model.quantities import Formulas
from model.schema import Drive, Inverter
from runtime.identify.signs import Sign, in_values, total_jacobian

#: The filter's own numbers: variances in V^2, V^2, (rad/s)^2, rad^2, (N m)^2, A^2 (alpha, beta, between them), a factor
#: of the ripple, by how much of a sample the edges' currents are earlier, the variance of d in V^2, what is kept of d.
TUNING: tuple[str, ...] = ("v_noise", "v_unsure", "omega_noise", "theta_noise", "torque_noise")
TUNING += ("R_alpha", "R_beta", "R_cross", "ripple", "lead", "drift_noise", "drift_kept")
OFFSETS = ("offset_alpha", "offset_beta")
#: What is given of the rotor in the first row: rad, rad/s, N m, their variances, and that of d.
START = ("theta", "omega", "load", "theta_var", "omega_var", "load_var", "drift_var")
#: A row of a recording: V, V, A, A; 1 if it was measured; variance of a step of the load torque, (N m)^2; for each leg
#: when it turns on, as a share of the sample, and how far the flux linkage is below its course then, V s, two axes.
ROW: tuple[str, ...] = ("u_alpha", "u_beta", "i_alpha", "i_beta", "measured", "step")
ROW += ("edge_a", "edge_b", "edge_c", *(f"swing_{leg}_{axis}" for leg in "abc" for axis in ("alpha", "beta")))
#: What a step tells: innovation (A) and its covariance (A^2).
TOLD = ("e_alpha", "e_beta", "S_aa", "S_ab", "S_bb")
#: States, and those of the motor among them.
STATES, MOTOR = 7, 5


def model_of(drive: Drive, letters: Parameters, constants: Formulas) -> StateSpaceModel:
    """The drive's machine with its load torque as a state, sampled exactly.

    The shipped machines are one motor in several coordinates; in flux linkages its sampled equations err least (with
    T R / L = 0.34 the back-EMF that is held over a sample makes R 0.2 % wrong).

    Parameters
    ----------
    drive : Drive
    letters : Parameters
    constants : Formulas
        Collects what is made of the letters alone.
    """
    own = drive.model.machine not in MACHINES
    sampled = {"machine": drive.model.machine if own else "salient_flux", "discretization": "exact"}
    model = drive.model.model_copy(update={**sampled, "mechanics": "load_torque", "adaptive": []})
    plain = drive.filter.model_copy(update={"root_order": None})
    changed = {"model": model, "inverter": Inverter(), "tolerance": None, "filter": plain}
    return build(drive.model_copy(update=changed), letters, constants)


@dataclass(frozen=True)
class Equations:
    """The step, the start and the constants of a parameter set, as CasADi functions.

    ``frozen``: letters that are zero and are to stay so, such as a friction that nobody asks for.
    """

    drive: Drive
    frozen: frozenset[str] = frozenset()

    @cached_property
    def letters(self) -> Parameters:
        """A symbol a datum."""
        symbols = {f.name: ca.SX(0) if f.name in self.frozen else ca.SX.sym(f.name) for f in fields(Parameters)}
        return Parameters(**symbols)

    @property
    def names(self) -> list[str]:
        """The letters of the data, in the order in which :attr:`constants` takes them."""
        return [f.name for f in fields(Parameters) if f.name not in self.frozen]

    @property
    def column(self) -> Any:
        """The letters of the data as a vector."""
        return ca.vertcat(*(getattr(self.letters, name) for name in self.names))

    @cached_property
    def _formulas(self) -> Formulas:
        return Formulas([getattr(self.letters, name) for name in self.names])

    @cached_property
    def _model(self) -> StateSpaceModel:
        return model_of(self.drive, self.letters, self._formulas)

    @cached_property
    def step(self) -> Any:
        """The step as a function of state with P (lower triangle by rows), parameters and row.

        It gives the next state with P, and what is told. The parameters are those of :attr:`parameter_names`.
        """
        x, row = ca.SX.sym("x", STATES), ca.SX.sym("row", len(ROW))
        tuning = {name: ca.SX.sym(name) for name in (*TUNING, *OFFSETS)}
        packed = ca.SX.sym("P", STATES * (STATES + 1) // 2)
        x_pred, P_pred = self._predicted(x, symmetric(ca.vertsplit(packed)), row, tuning)
        at = ca.SX.sym("x_pred", STATES)
        h = ca.vertcat(*self._model.measure(ca.vertsplit(at)[:MOTOR])[0])
        y_pred, H = (ca.substitute(part, at, x_pred) for part in (h, ca.jacobian(h, at)))
        e = row[2:4] - ca.vertcat(*(tuning[name] for name in OFFSETS)) - y_pred
        PH = P_pred @ H.T
        S = H @ PH + symmetric([tuning["R_alpha"], tuning["R_cross"], tuning["R_beta"]])
        det = S[0, 0] * S[1, 1] - S[0, 1] * S[0, 1]
        gain = (row[4] / det) * (PH @ symmetric([S[1, 1], -S[0, 1], S[0, 0]]))
        state = ca.vertcat(x_pred + gain @ e, *lower(P_pred - gain @ PH.T))
        made = list(self._formulas.symbols.values())
        parameters = ca.vertcat(self.column, *made, *tuning.values())
        told = ca.vertcat(e, S[0, 0], S[0, 1], S[1, 1])
        return ca.Function("innovate", [ca.vertcat(x, packed), parameters, row], [ca.cse(state), ca.cse(told)])

    def _predicted(self, x: Any, P: Any, row: Any, tuning: dict[str, Any]) -> tuple[Any, Any]:
        """x_pred and P_pred."""
        v, unsure, signs = self._applied(ca.vertsplit(x), ca.vertsplit(row), tuning["ripple"], tuning["lead"])
        v_sym = ca.SX.sym("v", 2)
        moved = ca.vertcat(*self._model.propagate(ca.vertsplit(x)[:MOTOR], ca.vertsplit(v_sym))[0])
        f = ca.substitute(ca.vertcat(moved, tuning["drift_kept"] * x[MOTOR:]), v_sym, v)
        G = ca.substitute(ca.vertcat(ca.jacobian(moved, v_sym), ca.SX(STATES - MOTOR, 2)), v_sym, v)
        F = total_jacobian(f, x, signs)
        x_pred, F, G, unsure = (in_values(part, signs) for part in (f, F, G, unsure))
        noise = tuning["v_noise"] + tuning["v_unsure"] * unsure
        drift = tuning["drift_noise"] * (1 - tuning["drift_kept"] * tuning["drift_kept"])
        walk = (0, 0, tuning["omega_noise"], tuning["theta_noise"], tuning["torque_noise"] + row[5], drift, drift)
        return x_pred, symmetric(lower(F @ P @ F.T + noise * (G @ G.T) + ca.diag(ca.vertcat(*walk))))

    def _applied(self, x: list[Any], row: list[Any], ripple: Any, lead: Any) -> tuple[Any, Any, list[Sign]]:
        """The voltage that arrives, (2,) V, in the signs of the legs' currents; how unsure those are; and the signs."""
        model, V_d = self._model, self.letters.V_d
        signs: list[Sign] = []

        def sign(current: Any) -> Any:
            signs.append(Sign.of(f"sign_{len(signs)}", current, self.letters.I_0))
            return signs[-1].symbol

        now, given = model.measure(x[:MOTOR])[0], (row[0] + x[MOTOR], row[1] + x[MOTOR + 1])
        first = clarke([sign(i) for i in legs(now)[0]])
        v = [u - V_d * g for u, g in zip(given, first, strict=True)]
        then = model.measure(model.propagate(x[:MOTOR], v)[0])[0]
        by_flux = ripple * self.inverse_inductance(x[:MOTOR])
        means, unsure = [], 1
        for leg, (before, after) in enumerate(zip(legs(now)[0], legs(then)[0], strict=True)):
            edge, r = row[6 + leg], legs(ca.vertsplit(by_flux @ ca.vertcat(*row[9 + 2 * leg : 11 + 2 * leg])))[0][leg]
            turns_on, turns_off = edge - lead, 1 - edge - lead
            on, off = (sign(before + t * (after - before) + s) for t, s in ((turns_on, -r), (turns_off, r)))
            means.append(0.5 * (on + off))
            unsure = unsure - (on * on + off * off) / 6
        return ca.vertcat(*(u - V_d * g for u, g in zip(given, clarke(means), strict=True))), unsure, signs

    def applied(self, letters: list[float]) -> Any:
        """The voltage that arrives, (2,) V, and how unsure its signs are, as a function of state and row.

        Parameters
        ----------
        letters : list of float
            In the order of :attr:`names`. The ripple counts as it is, at the edges themselves.
        """
        x, row = ca.SX.sym("x", STATES), ca.SX.sym("row", len(ROW))
        v, unsure, signs = self._applied(ca.vertsplit(x), ca.vertsplit(row), 1.0, 0.0)
        made = [self._formulas.in_letters(in_values(part, signs)) for part in (v, unsure)]
        return ca.Function("applied", [x, row], ca.substitute(made, [self.column], [ca.DM(letters)]))

    def in_letters(self, expression: Any) -> Any:
        """An expression with the constants' formulas in their places.

        Parameters
        ----------
        expression : SX
        """
        return self._formulas.in_letters(expression)

    def inverse_inductance(self, x: list[Any]) -> Any:
        """By how much the currents move with a voltage's integral, before they turn or decay: (2, 2), A / (V s).

        Parameters
        ----------
        x : list of SX
            The motor's states.
        """
        machine, speed = self._model.machine, self._model.mechanics.electrical_speed(x[2])
        z, v = ca.SX.sym("z", 2), ca.SX.sym("v", 2)
        rate = machine.derivative((z[0], z[1]), (v[0], v[1]), speed, Rotor.at(x[3]))
        i = machine.currents((z[0], z[1]), Rotor.at(x[3]))[0]
        moved = ca.jacobian(ca.vertcat(*i), z) @ ca.jacobian(ca.vertcat(*rate), v)
        return ca.substitute(moved, z, ca.vertcat(*x[:2]))

    @property
    def parameter_names(self) -> list[str]:
        """What a lane is given: letters, constants made of them, tuning, offsets."""
        _ = self.step
        return [*self.names, *self._formulas.symbols, *TUNING, *OFFSETS]

    @cached_property
    def constants(self) -> Any:
        """What is made of the letters, as a function of them, for as many sets as columns are given."""
        _ = self.step
        made = [self._formulas.in_letters(self._formulas.spelled[name]) for name in self._formulas.symbols]
        return ca.Function("made_of_letters", [self.column], [ca.vertcat(*made)])

    @cached_property
    def start(self) -> Any:
        """State and P of the first row, of letters, START, the measured currents (2,) and their variances R (3,).

        The electrical states are those that carry the currents at the angle; what is unknown of it is theirs, too.
        """
        given = {name: ca.SX.sym(name) for name in START}
        i, R, d = ca.SX.sym("i", 2), ca.SX.sym("R", 3), ca.SX.sym("d", 2)
        theta = given["theta"]
        z = ca.vertcat(*self._model.machine.electrical_state((i[0], i[1]), Rotor.at(theta)))
        x = ca.vertcat(z, given["omega"], theta, given["load"], d)
        J = ca.jacobian(x, ca.vertcat(i, given["omega"], theta, given["load"], d))
        variances = ("omega_var", "theta_var", "load_var", "drift_var", "drift_var")
        known = ca.diag(ca.vertcat(0, 0, *(given[name] for name in variances)))
        known[:2, :2] = symmetric(ca.vertsplit(R))
        state = ca.substitute(ca.vertcat(x, *lower(J @ known @ J.T)), d, ca.SX.zeros(2, 1))
        state = self._formulas.in_letters(state)
        return ca.Function("begin", [self.column, ca.vertcat(*given.values()), i, R], [state])


def symmetric(entries: list[Any]) -> Any:
    """A symmetric matrix of its lower triangle, row by row.

    Parameters
    ----------
    entries : list of SX
    """
    n = int((2 * len(entries)) ** 0.5)
    P, place = ca.SX(n, n), 0
    for i in range(n):
        for j in range(i + 1):
            P[i, j] = P[j, i] = entries[place]
            place += 1
    return P


def lower(P: Any) -> list[Any]:
    """The lower triangle of a symmetric matrix, row by row.

    Parameters
    ----------
    P : SX, (n, n)
    """
    return [P[i, j] for i in range(P.shape[0]) for j in range(i + 1)]
