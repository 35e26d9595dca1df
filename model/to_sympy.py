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
    ca.OP_FMIN: sp.Min,
    ca.OP_FMAX: sp.Max,
    ca.OP_SQRT: sp.sqrt,
    ca.OP_SIN: sp.sin,
    ca.OP_COS: sp.cos,
    ca.OP_EXP: sp.exp,
    ca.OP_EXPM1: lambda a: sp.exp(a) - 1,
}


def to_sympy(expression: Any) -> sp.Matrix:
    """A SymPy matrix of the same shape; symbols keep their names, small dyadic numbers become rationals.

    Parameters
    ----------
    expression : casadi.SX
        Over + - * / fmin fmax sqrt sin cos exp expm1.
    """
    function = _function(ca.symvar(expression), [ca.densify(expression)])
    values = _replay(function, [])[0]
    rows, columns = expression.shape
    return sp.Matrix(rows, columns, lambda i, j: values[i + j * rows])


def to_sympy_lines(named: dict[str, Any], rows: dict[str, Any]) -> list[tuple[sp.Symbol, sp.Expr]]:
    """Scalars as a list of definitions: each of ``named`` once, and from then on by its name; then the ``rows``.

    Parameters
    ----------
    named : dict of str to SX
        Intermediates, in the order in which they build on one another.
    rows : dict of str to SX
        What is made of them.

    Returns
    -------
    list of (Symbol, Expr)
        The name and what it is, real symbols throughout.
    """
    everything = {**named, **rows}
    values = [ca.SX(value) for value in everything.values()]
    function = _function(ca.symvar(ca.vertcat(*values)), values)
    results = _replay(function, list(named))
    return [(sp.Symbol(name, real=True), result[0]) for name, result in zip(everything, results, strict=True)]


def _function(symbols: list[Any], outputs: list[Any]) -> Any:
    """An SX function whose inputs are called like their symbols."""
    inputs = [str(symbol) for symbol in symbols]
    return ca.Function("expression", symbols, outputs, inputs, [f"out{k}" for k in range(len(outputs))])


def _replay(function: Any, cut: list[str]) -> list[dict[int, Any]]:
    """Walk a tape; the first outputs, as many as ``cut`` has names, are symbols to all that comes after them."""
    names = [sp.Symbol(str(function.name_in(k)), real=True) for k in range(function.n_in())]
    work: dict[int, Any] = {}
    outputs: list[dict[int, Any]] = [{} for _ in range(function.n_out())]
    for k in range(function.n_instructions()):
        op = function.instruction_id(k)
        source, target = function.instruction_input(k), function.instruction_output(k)
        if op == ca.OP_INPUT:
            work[target[0]] = names[source[0]]
        elif op == ca.OP_OUTPUT:
            outputs[target[0]][target[1]] = work[source[0]]
            if target[0] < len(cut):
                work[source[0]] = sp.Symbol(cut[target[0]], real=True)
        elif op == ca.OP_CONST:
            work[target[0]] = _rational(function.instruction_constant(k))
        else:
            work[target[0]] = _APPLY[op](*(work[s] for s in source[: _arity(op)]))
    return outputs


def _arity(op: int) -> int:
    return 2 if op in {ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_DIV, ca.OP_FMIN, ca.OP_FMAX} else 1


def _rational(number: float) -> sp.Rational:
    """A decimal fraction as it was written; a sum of powers of two, such as 1 - 2^-17, as what it is to the last digit.

    >>> _rational(0.1), _rational(1 - 2**-17)
    (1/10, 131071/131072)
    """
    exact = sp.Rational(number)
    return exact if exact.q <= 2**40 else sp.nsimplify(number, rational=True)
