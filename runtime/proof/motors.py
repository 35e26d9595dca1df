"""Link A: the motors' f, h and H in plain NumPy float64, by hand.

The second opinion on the equations: nothing of model, codegen or CasADi is imported, and they are written another
way, in vectors of the d-q plane where the model writes scalars. Numbers in brackets are the paper's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from runtime.proof.inverter import lost_volts

Array = NDArray[Any]

QUARTER_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])


class Plant(Protocol):
    """A discrete motor: x' = f(x, u), y = h(x), H = dh/dx.

    x (n, ...) and u (2, ...), the voltage that arrives: what follows the first axis are motors side by side. An H
    that is the same everywhere may stay (2, n).
    """

    def f(self, x: Array, u: Array) -> Array:
        """Return the state one sample later, (n,).

        Parameters
        ----------
        x : ndarray, (n, ...)
        u : ndarray, (2, ...)
            Voltages, V.
        """

    def h(self, x: Array) -> Array:
        """Return the currents, A, (2,).

        Parameters
        ----------
        x : ndarray, (n, ...)
        """

    def H(self, x: Array) -> Array:
        """Return dh/dx, (2, n).

        Parameters
        ----------
        x : ndarray, (n, ...)
        """


@dataclass(frozen=True)
class MotorData:
    """SI units; ``p`` pole pairs, ``T`` sample time. ``loaded``: the load torque is a fifth state.

    ``slow``: which of ``psi``, ``R`` and ``V_d`` are states, in their order at the state's end.
    """

    R: float
    L_d: float
    L_q: float
    psi: float
    p: int
    J: float
    D: float
    T: float
    exact: bool
    loaded: bool
    slow: tuple[str, ...] = ()
    slow_rate: float = 0.0
    V_d: float = 0.0

    def now(self, x: Array, name: str) -> Any:
        """``psi`` or ``R`` where the state is x.

        Parameters
        ----------
        x : ndarray, (n, ...)
        name : str
            The name.
        """
        return x[4 + self.loaded + self.slow.index(name)] if name in self.slow else getattr(self, name)

    def mechanics(self, x: Array, T_e: Any) -> list[Any]:
        """All of the state but its electrical part one sample later, under the electromagnetic torque T_e.

        Parameters
        ----------
        x : ndarray, (n, ...)
        T_e : object
        """
        w, th = x[2], x[3]
        if not self.exact:  # (7) rows 3 and 4; (1) where the torque is known
            w_next = (1 - self.T * self.D / self.J) * w
            w_next = w_next + (self.T / self.J * (T_e - x[4]) if self.loaded else 0.0)  # T_e may be complex, w not
            return [w_next, th + self.T * self.p * w, *self.rest(x)]
        # (1) solved for a torque that is held; where it is known the angle takes the mean of the speeds.
        z = self.T * self.D / self.J
        still = self.T * (-math.expm1(-z) / z if z else 1.0)  # integral of exp(-t D / J), s
        w_next = w * math.exp(-z) + (still / self.J * (T_e - x[4]) if self.loaded else 0.0)
        turned = self.T * (w + w_next) / 2 if self.loaded else still * w
        return [w_next, th + self.p * turned, *self.rest(x)]

    def rest(self, x: Array) -> list[Any]:
        """The load torque stays; slow states relax towards the motor's data.

        Parameters
        ----------
        x : ndarray, (n, ...)
        """
        first = 4 + self.loaded
        own = [getattr(self, name) for name in self.slow]
        return [*x[4:first], *(x[first + k] + self.slow_rate * (value - x[first + k]) for k, value in enumerate(own))]


@dataclass(frozen=True)
class SurfaceMotor:
    """x = [i_alpha, i_beta, omega, theta(, T_L)(, slow)], currents measured."""

    data: MotorData

    def f(self, x: Array, u: Array) -> Array:
        """Return the state one sample later, (n,).

        Parameters
        ----------
        x : ndarray, (n, ...)
        u : ndarray, (2, ...)
            Voltages, V.
        """
        d = self.data
        i_alpha, i_beta, w, th = x[:4]
        w_e = d.p * w
        R, psi = d.now(x, "R"), d.now(x, "psi")
        if not d.exact:  # (7)
            i = [
                (1 - d.T * R / d.L_d) * i_alpha + d.T * psi / d.L_d * w_e * np.sin(th) + d.T / d.L_d * u[0],
                (1 - d.T * R / d.L_d) * i_beta - d.T * psi / d.L_d * w_e * np.cos(th) + d.T / d.L_d * u[1],
            ]
            return np.array([*i, *d.mechanics(x, self.torque(x[:2], th, psi))])
        # (1) with the back-EMF held at the middle of the interval: a linear equation, solved exactly at the motor's R.
        z = d.T * d.R / d.L_d
        middle = th + d.T * w_e / 2
        e = psi * w_e * np.array([-np.sin(middle), np.cos(middle)])
        i = np.exp(-z) * x[:2] - np.expm1(-z) / d.R * (u - e - (R - d.R) * x[:2])
        return np.array([*i, *d.mechanics(x, self.torque((x[:2] + i) / 2, middle, psi))])

    def torque(self, i: Array, th: Any, psi: Any) -> Any:
        """(1): 1.5 p psi i_q.

        Parameters
        ----------
        i : ndarray
            Currents, A.
        th : object
            Electrical angle, rad.
        psi : object
            Flux linkages psi_alpha, psi_beta, Wb.
        """
        return 1.5 * self.data.p * psi * (i[1] * np.cos(th) - i[0] * np.sin(th))

    def h(self, x: Array) -> Array:
        """Return the currents, A, (2,).

        Parameters
        ----------
        x : ndarray, (n, ...)
        """
        return x[:2].copy()  # (5)

    def H(self, x: Array) -> Array:
        """Return dh/dx, (2, n).

        Parameters
        ----------
        x : ndarray, (n, ...)
        """
        return np.eye(2, len(x))


@dataclass(frozen=True)
class SalientMotor:
    """x = [i_alpha, i_beta, omega, theta(, T_L)(, slow)], currents measured; L(th) = R(th) diag(L_d, L_q) R(-th)."""

    data: MotorData

    def f(self, x: Array, u: Array) -> Array:
        """Return the state one sample later, (n,).

        Parameters
        ----------
        x : ndarray, (n, ...)
        u : ndarray, (2, ...)
            Voltages, V.
        """
        d = self.data
        i, w, th = x[:2], x[2], x[3]
        w_e = d.p * w
        R, psi = d.now(x, "R"), d.now(x, "psi")
        L = np.diag([d.L_d, d.L_q])
        # d/dth of R L R^T, seen from the rotor: what a turning inductance adds to the resistance, per rad/s.
        turning = QUARTER_TURN @ L - L @ QUARTER_TURN
        if not d.exact:  # L(th) di/dt = u - R i - w_e L'(th) i - e
            to_stator, to_rotor = rotation(th), rotation(-th)
            magnet = times(to_stator, np.array([0 * th, psi + 0 * th]))
            induced = w_e * (times(to_stator, times(turning, times(to_rotor, i))) + magnet)
            i_next = i + d.T * times(to_stator, times(np.linalg.inv(L), times(to_rotor, u - R * i - induced)))
            return np.array([*i_next, *d.mechanics(x, self.torque(i, th, psi))])
        middle = th + d.T * w_e / 2
        to_stator, to_rotor = rotation(middle), rotation(-middle)
        i_dq = times(to_rotor, i)
        e = np.array([0 * w_e, w_e * psi])
        left = times(to_rotor, u) - e - (R - d.R) * i_dq
        axes = np.array([d.L_d, d.L_q])

        def relax(t: float, i_coupling: Array) -> Array:
            z, held = t * d.R / axes, left - w_e * times(turning, i_coupling)
            return times(np.diag(np.exp(-z)), i_dq) - times(np.diag(np.expm1(-z) / d.R), held)

        i_next = times(to_stator, relax(d.T, relax(d.T / 2, i_dq)))
        return np.array([*i_next, *d.mechanics(x, self.torque((i + i_next) / 2, middle, psi))])

    def torque(self, i: Array, th: Any, psi: Any) -> Any:
        """1.5 p (psi_m + (L_d - L_q) i_d) i_q.

        Parameters
        ----------
        i : ndarray
            Currents, A.
        th : object
            Electrical angle, rad.
        psi : object
            Flux linkages psi_alpha, psi_beta, Wb.
        """
        d = self.data
        i_d, i_q = times(rotation(-th), i)
        return 1.5 * d.p * (psi + (d.L_d - d.L_q) * i_d) * i_q

    def h(self, x: Array) -> Array:
        """Return the currents, A, (2,)."""
        return x[:2].copy()  # (5)

    def H(self, x: Array) -> Array:
        """Return dh/dx, (2, n).

        Parameters
        ----------
        x : ndarray, (n, ...)
        """
        return np.eye(2, len(x))


@dataclass(frozen=True)
class SalientFluxMotor:
    """x = [psi_alpha, psi_beta, omega, theta(, T_L)(, slow)]; measured: i = R(th) L^-1 (R(-th) psi - [psi_m, 0])."""

    data: MotorData

    def f(self, x: Array, u: Array) -> Array:
        """Return the state one sample later, (n,).

        Parameters
        ----------
        x : ndarray, (n, ...)
        u : ndarray, (2, ...)
            Voltages, V.
        """
        d = self.data
        th, w_e = x[3], d.p * x[2]
        R, psi_m = d.now(x, "R"), d.now(x, "psi")
        magnet = np.array([psi_m + 0 * th, 0 * th])
        if not d.exact:
            psi = x[:2] + d.T * (u - R * self.currents(x[:2], th, psi_m))
            return np.array([*psi, *d.mechanics(x, self.torque(x[:2], th, psi_m))])
        # Rotor frame held at the middle of the interval; there d psi/dt = v - R L^-1 (psi - psi_m), diagonal, solved
        # exactly at the motor's own R.
        middle = th + d.T * w_e / 2
        to_stator, to_rotor = rotation(middle), rotation(-middle)
        L = np.array([d.L_d, d.L_q])
        z = d.T * d.R / L
        i = times(np.diag(1 / L), times(to_rotor, x[:2]) - magnet)
        psi_dq = times(to_rotor, x[:2]) + times(np.diag(-np.expm1(-z) / z * d.T), times(to_rotor, u) - R * i)
        # Meanwhile the magnet turns in that frame, from -T w_e / 2 to T w_e / 2.
        psi = times(to_stator, psi_dq + not_yet_relaxed(z[1]) * d.T * w_e / 2 * times(QUARTER_TURN, magnet))
        return np.array([*psi, *d.mechanics(x, self.torque((x[:2] + psi) / 2, middle, psi_m))])

    def torque(self, psi: Array, th: Any, psi_m: Any) -> Any:
        """1.5 p (psi x i).

        Parameters
        ----------
        psi : ndarray
            Flux linkages psi_alpha, psi_beta, Wb.
        th : object
            Electrical angle, rad.
        psi_m : object
            Magnet flux linkage, Wb.
        """
        i = self.currents(psi, th, psi_m)
        return 1.5 * self.data.p * (psi[0] * i[1] - psi[1] * i[0])

    def currents(self, psi: Array, th: Any, psi_m: Any) -> Array:
        """Return the currents of flux linkages, A, (2,)."""
        d = self.data
        inverse = np.diag([1 / d.L_d, 1 / d.L_q])
        i_dq = times(inverse, times(rotation(-th), psi) - np.array([psi_m + 0 * th, 0 * th]))
        return times(rotation(th), i_dq)

    def h(self, x: Array) -> Array:
        """Return the currents, A, (2,)."""
        return self.currents(x[:2], x[3], self.data.now(x, "psi"))

    def H(self, x: Array) -> Array:
        """By the product rule: di/dpsi = R L^-1 R^T; di/dth = R' i_dq + R L^-1 R'^T psi; di/dpsi_m = -R L^-1 e_d."""
        d = self.data
        to_stator, to_rotor = rotation(x[3]), rotation(-x[3])
        turned, turned_back = product(to_stator, QUARTER_TURN), -product(QUARTER_TURN, to_rotor)  # dR/dth, dR^T/dth
        inverse = np.diag([1 / d.L_d, 1 / d.L_q])
        i_dq = times(inverse, times(to_rotor, x[:2]) - np.array([d.now(x, "psi") + 0 * x[3], 0 * x[3]]))
        H = np.zeros((2, *x.shape))
        H[:, :2] = product(to_stator, product(inverse, to_rotor))
        H[:, 3] = times(turned, i_dq) + times(to_stator, times(inverse, times(turned_back, x[:2])))
        if "psi" in d.slow:
            H[:, 4 + d.loaded + d.slow.index("psi")] = -product(to_stator, inverse)[:, 0]
        return H


def not_yet_relaxed(z: Any) -> Any:
    """(1 + exp(-z)) (1 - tanh(z / 2) / (z / 2)), by Lambert's continued fraction of tanh, where nothing cancels.

    Parameters
    ----------
    z : float
        Time over the time constant.
    """
    y, inner = z / 2, 0.0 * z
    for odd in range(101, 1, -2):
        inner = y * y / (odd + inner)
    return (1 + np.exp(-z)) * inner / (1 + inner) if y.real < 20 else 1 - 1 / y


def times(matrix: Array, vector: Array) -> Array:
    """Each motor's matrix (m, k, ...) times its vector (k, ...); a matrix (m, k) is every motor's."""
    return np.asarray(np.einsum("ij...,j...->i...", matrix, vector))


def product(a: Array, b: Array) -> Array:
    """:func:`times` for two matrices."""
    return np.asarray(np.einsum("ij...,jk...->ik...", a, b))


def rotation(angle: Any) -> Array:
    """d-q to alpha-beta.

    Parameters
    ----------
    angle : float or ndarray
        Electrical, rad.
    """
    s, c = np.sin(angle), np.cos(angle)
    return np.array([[c, -s], [s, c]])


MOTORS: dict[str, type[SurfaceMotor] | type[SalientMotor] | type[SalientFluxMotor]] = {
    "surface": SurfaceMotor,
    "salient": SalientMotor,
    "salient_flux": SalientFluxMotor,
}
SLOW = {"magnet_flux": "psi", "stator_resistance": "R", "dead_time_voltage": "V_d"}


def make_motor(parameters: Mapping[str, Any]) -> Plant:
    """The motor of a drive file's parsed sections ``motor`` and ``model``."""
    return MOTORS[parameters["model"]["machine"]](motor_data(parameters))


def motor_data(parameters: Mapping[str, Any]) -> MotorData:
    """The numbers of a drive file's parsed sections, with the mechanics that go with them."""
    m, model = parameters["motor"], parameters["model"]
    return MotorData(
        R=m["stator_resistance"],
        L_d=m["inductance_d"],
        L_q=m["inductance_q"],
        psi=m["magnet_flux"],
        p=m["pole_pairs"],
        J=m["inertia"],
        D=m["friction"],
        T=model["sample_time"],
        exact=model["discretization"] == "exact",
        loaded={"constant_speed": False, "load_torque": True}[model.get("mechanics", "constant_speed")],
        slow=tuple(SLOW[word] for word in model.get("adaptive", ())),
        slow_rate=2.0 ** round(math.log2(model["sample_time"] / model.get("adaptive_time", 1.0))),
        V_d=lost_volts(parameters),
    )
