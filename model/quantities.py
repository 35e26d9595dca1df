"""Named quantities and stages: what gives the generated code its words."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import casadi as ca


@dataclass(frozen=True)
class Quantity:
    """One scalar the field has a name for.

    ``name`` becomes the identifier in C and Python, ``symbol`` the LaTeX, ``unit`` the comment.
    """

    name: str
    symbol: str
    unit: str
    meaning: str


@dataclass(frozen=True)
class Constant:
    """A number folded at generation that keeps its name: ``value`` of ``formula``, standing for ``symbol``.

    Without a symbol (None) it is the name of that number wherever a block holds it.
    """

    name: str
    value: float
    formula: str
    symbol: Any


class ConstantError(ValueError):
    """One name for two numbers; the message is one line."""


def _same(one: Constant, other: Constant) -> Constant:
    """The first, if both stand for one number."""
    if one.value != other.value:
        raise ConstantError(
            f"constant {one.name} is {one.formula} = {one.value!r} and {other.formula} = {other.value!r}: "
            "one of them needs another name"
        )
    return one


def united(*groups: Iterable[Constant]) -> list[Constant]:
    """Constants of several blocks that meet in one file, each once.

    Parameters
    ----------
    *groups : iterable of Constant
        The constants of one block each.

    Returns
    -------
    list of Constant
        In order of appearance.

    Raises
    ------
    ConstantError
        One name stands for two numbers.
    """
    found: dict[str, Constant] = {}
    for constant in (constant for group in groups for constant in group):
        _same(found.setdefault(constant.name, constant), constant)
    return list(found.values())


class Constants:
    """Collects the folded constants of a model, so that the generated code can name them.

    With ``named=True`` an expression sees the constant as one symbol (CasADi would otherwise fold it into
    its neighbours and the name would be lost); with ``named=False`` it sees the formula itself.

    >>> constants = Constants(named=True)
    >>> constants("DECAY", ca.SX(0.5), "1 - T R / L")
    SX(DECAY)
    >>> constants.items["DECAY"].value
    0.5
    """

    def __init__(self, named: bool) -> None:
        self._named = named
        self.items: dict[str, Constant] = {}

    def __call__(self, name: str, value: Any, formula: str) -> Any:
        """The symbol that stands for ``value``; a value that hangs on a state is no constant and is returned.

        Raises
        ------
        ConstantError
            The name stands for another value already.
        """
        if not self._named:
            return value
        known = self.numeric(ca.SX(value))
        if not known.is_constant():
            return value
        number = float(known)
        if number in (0.0, 1.0):  # nothing worth a name: let CasADi drop the operation
            return ca.SX(number)
        constant = self.items.setdefault(name, Constant(name, number, formula, ca.SX.sym(name)))
        return _same(constant, Constant(name, number, formula, constant.symbol)).symbol

    def numeric(self, expression: Any) -> Any:
        """``expression`` with every constant's symbol replaced by its number.

        Parameters
        ----------
        expression : object
            A CasADi expression.
        """
        known = list(self.items.values())
        if not known or expression.is_constant():
            return expression
        return ca.substitute(expression, ca.vertcat(*(c.symbol for c in known)), ca.DM([c.value for c in known]))


class Formulas(Constants):
    """The constants of a model whose data are letters: a symbol each, and beside it what it is in those letters.

    >>> formulas = Formulas([L := ca.SX.sym("L")])
    >>> formulas("INV_L", 1 / L, "1 / L"), formulas.spelled["INV_L"]
    (SX(INV_L), SX((1./L)))
    """

    def __init__(self, letters: Iterable[Any]) -> None:
        super().__init__(named=False)
        self._letters = {str(letter) for letter in letters}
        self.symbols: dict[str, Any] = {}
        self.spelled: dict[str, Any] = {}

    def __call__(self, name: str, value: Any, formula: str) -> Any:
        """The symbol that stands for ``value``, a value of the letters alone; any other is returned."""
        spelled = self.in_letters(ca.SX(value))
        if not {str(symbol) for symbol in ca.symvar(spelled)} <= self._letters:
            return value
        self.spelled.setdefault(name, spelled)
        return self.symbols.setdefault(name, ca.SX.sym(name))

    def in_letters(self, expression: Any) -> Any:
        """``expression`` with every constant's symbol replaced by its formula.

        Parameters
        ----------
        expression : object
            A CasADi expression.
        """
        if not self.symbols:
            return expression
        formulas = ca.vertcat(*(self.spelled[name] for name in self.symbols))
        return ca.substitute(expression, ca.vertcat(*self.symbols.values()), formulas)

    def slopes(self, letter: Any) -> dict[str, Any]:
        """The derivative of each constant with respect to a letter, by name; those that do not hang on it left out.

        Parameters
        ----------
        letter : SX
            One of the letters.
        """
        slopes = {name: ca.jacobian(formula, letter) for name, formula in self.spelled.items()}
        return {name: slope for name, slope in slopes.items() if not slope.is_zero()}

    def along(self, expression: Any, letter: Any, step: Any, steps: dict[str, Any]) -> Any:
        """The change of ``expression`` where a letter and its constants change, to first order.

        Parameters
        ----------
        expression : SX, (n, 1)
        letter : SX
        step : SX
            The letter's change.
        steps : dict of str to SX
            The constants' changes, by name.
        """
        where = ca.vertcat(letter, *(self.symbols[name] for name in steps))
        return ca.jtimes(expression, where, ca.vertcat(step, *steps.values()))


@dataclass(frozen=True)
class Stage:
    """A quantity of the paper inside a filter step: its name, equation, entries and their names.

    ``rows`` says, entry by entry, which row the entry belongs to: the proof judges an error on its row's
    scale, which is the row's largest entry or, where that may vanish, what ``scale`` names: ``"state"`` one
    sigma of the state, ``"output"`` one sigma of the measurement noise, ``"cross"`` and ``"gain"`` the size
    a cross covariance and a gain have by their sigmas, ``"row"`` nothing more. An entry of a ``"covariance"`` is judged
    by the product of its two sigmas, whose units it has; of an ``"addend"`` of P_pred at least by a share of that of
    P_pred, and of a ``"difference"`` of covariances at least by a share of that of the minuend. ``"none"``: a working
    quantity that is named but not compared.
    """

    name: str
    equation: str
    meaning: str
    entries: tuple[Any, ...]
    names: tuple[str, ...]
    rows: tuple[int, ...]
    scale: str


@dataclass(frozen=True)
class Port:
    """An array that enters or leaves a block: its name, length, and the scalars in it."""

    name: str
    entries: tuple[Any, ...]
    names: tuple[str, ...]


@dataclass(frozen=True)
class Block:
    """A pure function of arrays, printed as one C and one Python function."""

    name: str
    title: str
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    stages: tuple[Stage, ...]
