"""The second statement of a drive's motor, from which the reference filters, and what the two statements say alike.

A shipped machine has its statement in :mod:`runtime.proof.motors` and one more in SymPy. A machine file of one's own
may hold one as a function ``reference(parameters)``. Where it does not, the motor's equations go unchecked, and the
proof says so: the reference then filters with CasADi's own f, h, F and H.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from codegen.evidence.box import sample_box
from model.machines import MACHINES
from model.machines.own import MachineError, load_module, read_word, running
from model.machines.state_space import StateSpaceModel, build
from model.machines.tolerance import DATA, deviations
from model.schema import Drive
from runtime.proof.motors import Plant, make_motor
from runtime.proof.reference import jacobian
from runtime.proof.result import Link, Row
from runtime.proof.wrong_data import STEP, moved_data
from runtime.system.errors import UserError

Array = NDArray[Any]

#: Both statements are float64 and differ in the order of operations; on the scale of an entry's largest value.
ALLOWED = 1e-10
POINTS = 300

UNCHECKED = "motor's equations: no second statement, not checked"
CLAIM = "CasADi = the machine file's own reference, float64"


def second_motor(drive: Drive) -> Plant:
    """The model that the reference filters with.

    Parameters
    ----------
    drive : Drive
        Its machine is a shipped one or one's own.

    Raises
    ------
    UserError
        The machine file's ``reference`` fails, or does not return what it should.
    """
    if drive.model.machine in MACHINES:
        return make_motor(drive.model_dump())
    model = build(drive)
    return _stated(drive, len(model.states)) or CasadiMotor(model)


def compare_statements(drive: Drive) -> Link | None:
    """How CasADi's equations and the second statement compare; None if there is no second one.

    Parameters
    ----------
    drive : Drive
        Its machine is a shipped one or one's own.

    Raises
    ------
    UserError
        As :func:`second_motor`.
    """
    if drive.model.machine in MACHINES:
        from runtime.proof.derivation import compare_derivations  # SymPy, which no other link needs

        return compare_derivations(drive)
    motor = second_motor(drive)
    return compare_numbers(drive, build(drive), motor) if isinstance(motor, StatedMotor) else None


class CasadiMotor:
    """f, h, F and H of a model, called with numbers."""

    def __init__(self, model: StateSpaceModel) -> None:
        x, v, *signs = model.arguments
        G = [ca.densify(column) for letter, column in model.G.items() if letter in DATA]  # others act by the voltage
        exprs = [model.f, ca.densify(model.F), ca.densify(ca.jacobian(model.f, v)), *G]
        for g in signs:  # the voltage is the one that arrives
            exprs = [ca.substitute(e, g, ca.DM.zeros(g.shape)) for e in exprs]
        self._f, self._F, self._B, *columns = (ca.Function("f", [x, v], [model.numeric(e)]) for e in exprs)
        self._h, self._H = (ca.Function("h", [x], [model.numeric(e)]) for e in (model.h, ca.densify(model.H)))
        self.moved: list[tuple[Any, float]] = [(_MovedMotor(column), 1.0) for column in columns]

    def f(self, x: Array, u: Array) -> Array:
        """Return the state one sample later, (n,); to first order along a voltage's imaginary part.

        Parameters
        ----------
        x : ndarray
            State, in the model's order.
        u : ndarray
            Voltages, V, (N, 2).
        """
        after = np.array(self._f(x, u.real)).reshape(x.shape)
        return after + 1j * np.einsum("ij...,j...->i...", self.B(x, u.real), u.imag) if np.iscomplexobj(u) else after

    def h(self, x: Array) -> Array:
        """Return the currents, A, (2,).

        Parameters
        ----------
        x : ndarray
            State, in the model's order.
        """
        return np.array(self._h(x)).reshape(2, *x.shape[1:])

    def F(self, x: Array, u: Array) -> Array:
        """Return df/dx, (n, n).

        Parameters
        ----------
        x : ndarray
            State, in the model's order.
        u : ndarray
            Voltages, V, (N, 2).
        """
        return _beside(self._F(x, u), x)

    def B(self, x: Array, u: Array) -> Array:
        """Return df/du, (n, 2).

        Parameters
        ----------
        x : ndarray
            State, in the model's order.
        u : ndarray
            Voltages, V, (N, 2).
        """
        return _beside(self._B(x, u), x, columns=2)

    def H(self, x: Array) -> Array:
        """Return dh/dx, (2, n).

        Parameters
        ----------
        x : ndarray
            State, in the model's order.
        """
        return _beside(self._H(x), x)


class _MovedMotor:
    """A motor with a datum moved along the imaginary axis, as CasADi's derivative has it: f alone."""

    def __init__(self, slope: Any) -> None:
        self._slope = slope

    def f(self, x: Array, u: Array) -> Array:
        """Return the derivative as the imaginary part, (n,)."""
        return 1j * STEP * np.array(self._slope(x, u)).reshape(x.shape)


def _beside(found: ca.DM, x: Array, columns: int = 0) -> Array:
    """CasADi's matrices (m, lanes n) for x (n, lanes), one after the other, as (m, n, lanes); or n ``columns``."""
    matrices = np.array(found)
    return np.moveaxis(matrices.reshape(len(matrices), *x.shape[1:], columns or len(x)), -1, 1)


class StatedMotor:
    """f and h of a machine file's reference, errors in them said in a line; H its own, or by complex steps.

    The file states them for one motor; of several side by side each is asked in turn.
    """

    def __init__(self, motor: Any, states: int, say: Callable[..., Any]) -> None:
        self._motor, self._n, self._say = motor, states, say
        self.moved: list[tuple[Any, float]] = []

    @property
    def states_H(self) -> bool:
        """Whether H is the reference's own."""
        return hasattr(self._motor, "H")

    def f(self, x: Array, u: Array) -> Array:
        """Return the state one sample later, (n,).

        Parameters
        ----------
        x : ndarray
            State, in the model's order.
        u : ndarray
            Voltages, V, (N, 2).
        """
        return _in_turn(lambda x, u: self._checked("f", self._n, x, u), x, u)

    def h(self, x: Array) -> Array:
        """Return the currents, A, (2,).

        Parameters
        ----------
        x : ndarray
            State, in the model's order.
        """
        return _in_turn(lambda x: self._checked("h", 2, x), x)

    def H(self, x: Array) -> Array:
        """Return dh/dx, (2, n).

        Parameters
        ----------
        x : ndarray
            State, in the model's order.
        """
        return _in_turn(self._slope if self.states_H else lambda x: jacobian(self.h, x), x)

    def lacking(self, x: Array, i: Array) -> Array:
        """What a sample lacks by the motor's data where the currents are i, (n,); its change with a datum counts.

        Parameters
        ----------
        x : ndarray
            State, in the model's order.
        i : ndarray
            Currents, A.
        """
        return self._checked("lacking", self._n, x, i)

    def _slope(self, x: Array) -> Array:
        return np.asarray(self._checked("H", 2 * self._n, x)).reshape(2, self._n)

    def _checked(self, name: str, entries: int, *arguments: Array) -> Array:
        found = np.asarray(self._say(name, getattr(self._motor, name), *arguments))
        if found.size != entries or found.dtype.kind not in "fc":
            raise UserError(
                f"reference(parameters).{name} of the machine file must return {entries} numbers, not {found.size} "
                f"of type {found.dtype}."
            )
        return found


@dataclass(frozen=True)
class _WrongCurrents:
    """A stated motor whose inductance or magnet is moved: currents are read wrong, and f lacks what they make."""

    moved: StatedMotor
    right: StatedMotor

    def f(self, x: Array, u: Array) -> Array:
        """A complex (n,) whose imaginary part is what a sample lacks."""
        return _in_turn(self.moved.lacking, x, self.right.h(x))


def _in_turn(function: Callable[..., Array], *arguments: Array) -> Array:
    """A function of vectors, of each lane of (n, lanes)."""
    if arguments[0].ndim == 1:
        return function(*arguments)
    return np.stack([function(*lane) for lane in zip(*(a.T for a in arguments), strict=True)], axis=-1)


def _stated(drive: Drive, states: int) -> StatedMotor | None:
    """The machine file's own reference, if it has one."""
    word = read_word(drive.model.machine)
    assert word is not None
    make = getattr(load_module(word, drive.machine_text), "reference", None)
    if make is None:
        return None

    def say(name: str, function: Callable[..., Any], *arguments: Any) -> Any:
        try:
            return running(word, f"reference(parameters).{name}" if name else "reference", function, *arguments)
        except MachineError as error:
            raise UserError(str(error)) from None

    if not callable(make):
        raise UserError(f"machine file '{word.file}': reference must be a function of a drive file's parsed sections.")
    motor = say("", make, drive.model_dump())
    for name in ("f", "h"):
        if not callable(getattr(motor, name, None)):
            raise UserError(f"machine file '{word.file}': what reference(parameters) returns has no method {name}.")
    stated = StatedMotor(motor, states, say)
    through = build(drive).flux_slopes if drive.tolerance else {}
    # Complex motor data: its formulas are to be NumPy's.
    for letter, (sections, deviation) in zip(deviations(drive), moved_data(drive.model_dump()), strict=True):
        moved = StatedMotor(say("", make, sections), states, say)
        if letter in through and not hasattr(motor, "lacking"):
            raise UserError(
                f"machine file '{word.file}': its class says what a sample lacks where {letter} is wrong (lacking); "
                "what reference(parameters) returns must say so, too: lacking(x, i), docs/own_machine.md."
            )
        stated.moved.append((_WrongCurrents(moved, stated) if letter in through else moved, deviation))
    return stated


def compare_numbers(drive: Drive, model: StateSpaceModel, stated: StatedMotor) -> Link:
    """f, h, F, H at random points of the operating box; the reference's F and H by complex steps, and its own H.

    Parameters
    ----------
    drive : Drive
        Its operating box gives the points.
    model : StateSpaceModel
        CasADi's.
    stated : StatedMotor
        The second statement.
    """
    ours = CasadiMotor(model)
    box = sample_box(drive, model, POINTS, seed=2)
    pairs: dict[str, list[tuple[Array, Array]]] = {}
    for x, u in zip(box.x.T, box.u.T, strict=True):
        pairs.setdefault("f", []).append((stated.f(x, u), ours.f(x, u)))
        pairs.setdefault("h", []).append((stated.h(x), ours.h(x)))
        pairs.setdefault("F", []).append((jacobian(lambda at, u=u: stated.f(at, u), x), ours.F(x, u)))  # type: ignore[misc]
        pairs.setdefault("H", []).append((jacobian(stated.h, x), ours.H(x)))
        if stated.states_H:
            pairs.setdefault("H, as the reference states it", []).append((stated.H(x), ours.H(x)))
    equations = {"f": "7", "h": "5", "F": "df/dx"}
    rows = [
        Row(equations.get(name, "dh/dx"), name, "worst deviation", _worst(found), ALLOWED, found[0][0].size * POINTS)
        for name, found in pairs.items()
    ]
    return Link("model", CLAIM, drive.name, "f, h, F, H", "-", f"operating box, {POINTS} points", tuple(rows))


def _worst(pairs: list[tuple[Array, Array]]) -> float:
    """Largest deviation, each entry on the scale of its largest value at any point; of at least 1e-9 of its row's."""
    theirs, mine = (np.array(side) for side in zip(*pairs, strict=True))
    size = np.abs(mine).max(axis=0)
    scale = np.maximum(size, 1e-9 * size.max(axis=-1, keepdims=True) + 1e-300)
    worst = float((np.abs(theirs - mine) / scale).max())
    return worst if np.isfinite(worst) else float("inf")
