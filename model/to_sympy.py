"""CasADi expressions as SymPy ones: for printing equations and for comparing with a second derivation."""

from __future__ import annotations

from typing import Any

import casadi as ca
import sympy as sp

_APPLY = {
    ca.OP_ADD: lambda a, b: a + b,
    ca.OP_SUB: lambda a, b: a - b,
    ca.OP_MUL: lambda a, b: a * b,
    ca.OP_DIV: lambda a, b: a / b,
    ca.OP_NEG: lambda a: -a,
    ca.OP_SQ: lambda a: a**2,
    ca.OP_TWICE: lambda a: 2 * a,
    ca.OP_INV: lambda a: 1 / a,
    ca.OP_SQRT: sp.sqrt,
    ca.OP_SIN: sp.sin,
    ca.OP_COS: sp.cos,
    ca.OP_EXP: sp.exp,
}


def to_sympy(expression: Any) -> sp.Matrix:
    """A SymPy matrix of the same shape; symbols keep their names, small dyadic numbers become rationals.

    Parameters
    ----------
    expression : casadi.SX
        Over + - * / sqrt sin cos exp.
    """
    symbols = ca.symvar(expression)
    function = ca.Function("expression", symbols, [ca.densify(expression)])
    names = [sp.Symbol(str(symbol), real=True) for symbol in symbols]
    work: dict[int, Any] = {}
    values: dict[int, Any] = {}
    for k in range(function.n_instructions()):
        op = function.instruction_id(k)
        source, target = function.instruction_input(k), function.instruction_output(k)
        if op == ca.OP_INPUT:
            work[target[0]] = names[source[0]]
        elif op == ca.OP_OUTPUT:
            values[target[1]] = work[source[0]]
        elif op == ca.OP_CONST:
            work[target[0]] = sp.nsimplify(function.instruction_constant(k), rational=True)
        else:
            work[target[0]] = _APPLY[op](*(work[s] for s in source[: _arity(op)]))
    rows, columns = expression.shape
    return sp.Matrix(rows, columns, lambda i, j: values[i + j * rows])


def _arity(op: int) -> int:
    return 2 if op in {ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_DIV} else 1
