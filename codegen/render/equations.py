"""A drive's equations in letters: for the second derivation in full, for people with named intermediates."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import sympy as sp

from model.machines.base import Parameters
from model.machines.state_space import INPUTS, OUTPUTS, SIGNS, UNSURE, StateSpaceModel, build
from model.machines.tolerance import deviations, wrong_voltage
from model.quantities import Constant, Formulas
from model.schema import Drive
from model.to_sympy import to_sympy, to_sympy_lines

#: What may be wrong, as one writes it: motor data, and the inverter's voltage along and across the rotor.
DATA_LATEX = {"R": "R", "L_d": "L_d", "L_q": "L_q", "psi_m": r"\psi_m", "V_d": "V_d"}
DATA_LATEX |= {"loss_along": r"\parallel", "loss_across": r"\perp"}


@dataclass(frozen=True)
class Equations:
    """x' = f(x, u), y = h(x), F = df/dx, H = dh/dx, motor data as symbols."""

    f: sp.Matrix
    h: sp.Matrix
    F: sp.Matrix
    H: sp.Matrix


def equations(drive: Drive) -> Equations:
    """Derive a drive's discrete model with letters for its motor data.

    Parameters
    ----------
    drive : Drive
        Which machine, mechanics and discretisation.
    """
    model = build(drive, Parameters.symbolic())
    return Equations(*(to_sympy(expression) for expression in (model.f, model.h, model.F, model.H)))


def slopes(drive: Drive) -> dict[str, sp.Matrix]:
    """df/dp of each datum that may be wrong, (n, 1), all data letters: by the chain rule through f's constants.

    Of a datum of h what f lacks in its place (:attr:`model.machines.state_space.StateSpaceModel.flux_slopes`).

    And df/dv along and across the rotor, where the inverter's loss may be off.

    Parameters
    ----------
    drive : Drive
        Its ``[tolerance]`` says which.
    """
    parameters = Parameters.symbolic()
    formulas = Formulas(vars(parameters).values())
    f = build(drive, parameters, formulas).f
    found = {}
    through = build(drive, parameters).flux_slopes
    for name in deviations(drive):
        letter = getattr(parameters, name)
        if name in through:
            found[name] = to_sympy(through[name])
            continue
        found[name] = to_sympy(formulas.in_letters(formulas.along(f, letter, ca.SX(1), formulas.slopes(letter))))
    if wrong_voltage(drive):
        by_volts = build(drive, parameters).voltage_slopes
        found |= {letter: to_sympy(slope) for letter, slope in by_volts.items()}
    return found


@dataclass(frozen=True)
class Readable:
    """The model as one would write it down, each line a (left side, right side).

    Constants keep the names they have in the generated code. ``symbols`` holds LaTeX for names that need it.
    ``inverter``: the voltage that f takes, of the one that is commanded; empty where it is that.
    """

    inverter: list[tuple[sp.Symbol, sp.Expr]]
    f: list[tuple[sp.Symbol, sp.Expr]]
    h: list[tuple[sp.Symbol, sp.Expr]]
    H: sp.Matrix
    G: list[tuple[sp.Symbol, sp.Expr]]
    constants: list[Constant]
    symbols: dict[sp.Symbol, str]

    def latex(self, expression: Any) -> str:
        """Spell an expression in LaTeX.

        Parameters
        ----------
        expression : sympy object
        """
        text: str = sp.latex(expression, symbol_names=self.symbols, mat_delim="[")
        return text


def readable(drive: Drive) -> Readable:
    """f and h line by line through their named intermediates; H and G in terms of those of h and f.

    Parameters
    ----------
    drive : Drive
    """
    model = build(drive)
    f = _lines(model.propagate, model.arguments, [f"{state.name}_next" for state in model.states])
    h = _lines(model.measure, [model.x], [f"y_{quantity.name}" for quantity in OUTPUTS])
    H = to_sympy(model.H)
    for symbol, expression in reversed(h[:-2]):
        H = H.subs(_in_full(expression, h), symbol)
    lines = _inverter_lines(model), f, h, H, _wrong_data_lines(model)
    return Readable(*lines, model.constants, _latex_names(model))


def _wrong_data_lines(model: StateSpaceModel) -> list[tuple[sp.Symbol, sp.Expr]]:
    """Entries of G that are not zero, in terms of f's intermediates and of entries before them."""
    named = dict(model.propagate(*map(ca.vertsplit, model.arguments))[1])
    entries = {
        f"G_{state.name}_{letter}": column[i]
        for letter, column in model.G.items()
        for i, state in enumerate(model.states)
        if not column[i].is_zero()
    }
    return to_sympy_lines({**named, **entries}, {})[len(named) :] if entries else []


#: The voltage as it is commanded, where it is not the one that f takes.
COMMANDED = ("u_alpha", "u_beta")


def _inverter_lines(model: StateSpaceModel) -> list[tuple[sp.Symbol, sp.Expr]]:
    """What f takes of a commanded voltage, line by line."""
    if model.lost is None:
        return []
    applied, named = model.applied(ca.vertsplit(model.x), [ca.SX.sym(name) for name in COMMANDED])
    rows = {
        quantity.name: value
        for name, quantities in model.inputs.items()
        for quantity, value in zip(quantities, applied[name], strict=True)
    }
    roots = {math.sqrt(3) / 2: sp.sqrt(3) / 2, 1 / math.sqrt(3): sp.sqrt(3) / 3}
    return [(name, with_roots(line, roots)) for name, line in to_sympy_lines(named, rows)]


def with_roots(line: Any, roots: dict[float, sp.Expr]) -> Any:
    """A formula with these numbers as what they are, where CasADi has float64 and SymPy 15 digits of it.

    Parameters
    ----------
    line : Expr or Matrix
    roots : dict of float to Expr
        What each number, or the negative of it, stands for.
    """
    found = {
        number: sp.sign(number) * exact
        for number in line.atoms(sp.Rational)
        for value, exact in roots.items()
        if abs(abs(number) - value) < 1e-14
    }
    return line.xreplace(found)


def _lines(function: Callable[..., Any], arguments: list[Any], names: list[str]) -> list[tuple[sp.Symbol, sp.Expr]]:
    """Definitions of a function's named intermediates, then its rows in terms of them."""
    values, named = function(*map(ca.vertsplit, arguments))
    return to_sympy_lines(dict(named), dict(zip(names, values, strict=True)))


def _in_full(expression: sp.Expr, lines: list[tuple[sp.Symbol, sp.Expr]]) -> sp.Expr:
    """An expression with the names of earlier lines written out."""
    for symbol, definition in reversed(lines):
        expression = expression.subs(symbol, definition)
    return expression


def _latex_names(model: StateSpaceModel) -> dict[sp.Symbol, str]:
    names = {quantity.name: quantity.symbol for quantity in (*model.states, *INPUTS, *SIGNS, UNSURE)}
    names |= {f"{state.name}_next": f"{state.symbol}'" for state in model.states}
    names |= {f"sign_{leg}": f"s_{leg}" for leg in "abc"} | {"seen": r"\sigma"}
    names |= {f"whole_{axis}": rf"\bar g_\{axis}" for axis in ("alpha", "beta")}
    names |= {name: rf"u_\{name.removeprefix('u_')}" for name in COMMANDED}
    names |= {f"y_{quantity.name}": f"y_{k + 1}" for k, quantity in enumerate(OUTPUTS)}
    names |= {constant.name: rf"\mathtt{{{constant.name}}}".replace("_", r"\_") for constant in model.constants}
    names |= {
        f"G_{state.name}_{letter}": f"G_{{{state.symbol}, {DATA_LATEX[letter]}}}"
        for state in model.states
        for letter in model.G
    }
    return {sp.Symbol(name, real=True): latex for name, latex in names.items()}


def sparsity(model: StateSpaceModel) -> dict[str, str]:
    """Structural non-zeros of F and H, as 'k of n'.

    Parameters
    ----------
    model : StateSpaceModel

    Returns
    -------
    dict of str to str
        By "F" and "H".
    """
    return {name: f"{matrix.nnz()} of {matrix.numel()}" for name, matrix in (("F", model.F), ("H", model.H))}
