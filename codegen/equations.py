"""A drive's equations in letters: f, h and their Jacobians as SymPy matrices and as LaTeX."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import sympy as sp

from model.drive import Drive
from model.machines.base import Parameters
from model.state_space import INPUTS, StateSpaceModel, build
from model.to_sympy import to_sympy

_PARAMETER_LATEX = {"psi_m": r"\psi_m", "L_d": "L_d", "L_q": "L_q"}


@dataclass(frozen=True)
class Equations:
    """x' = f(x, u), y = h(x), F = df/dx, H = dh/dx, with motor data as symbols."""

    f: sp.Matrix
    h: sp.Matrix
    F: sp.Matrix
    H: sp.Matrix
    symbols: dict[sp.Symbol, str]

    def latex(self, expression: Any) -> str:
        """LaTeX, the states in the field's letters."""
        text: str = sp.latex(expression, symbol_names=self.symbols)
        return re.sub(r"\\operatorname\{(\w+)\}", r"\\mathrm{\1}", text)


def equations(drive: Drive) -> Equations:
    """Derive a drive's discrete model with letters for its motor data."""
    model = build(drive, Parameters.symbolic())
    named = {quantity.name: quantity.symbol for quantity in (*model.states, *INPUTS)}
    symbols = {sp.Symbol(name, real=True): latex for name, latex in {**named, **_PARAMETER_LATEX}.items()}
    matrices = (to_sympy(expression) for expression in (model.f, model.h, model.F, model.H))
    return Equations(*matrices, symbols)


def sparsity(model: StateSpaceModel) -> dict[str, str]:
    """Structural non-zeros of F and H, as 'k of n'."""
    return {
        name: f"{matrix.nnz()} of {matrix.numel()}" for name, matrix in (("F", model.F), ("H", model.H))
    }
