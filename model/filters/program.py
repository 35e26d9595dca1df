"""The control flow of a step: calls of pure blocks, one bounded loop, branches, and what the status tells.

Small on purpose: C prints it with ``for`` and ``if``, NumPy and C's lane form with masks over a batch, and all compute
the same bits. Arrays are known by name; ``x, P`` are the state, ``Q, R`` the tuning, ``u, y`` the inputs.
Conditions and values are in :mod:`model.filters.conditions`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, TypeVar

import casadi as ca

from model.filters.conditions import All, Compare, Condition, Either, Entry, Not, Operation, Value
from model.machines.state_space import StateSpaceModel
from model.quantities import Block, Port, Stage

#: A kind of node.
N = TypeVar("N")


@dataclass(frozen=True)
class Guard:
    """The input guard, first of a step: holds u if it is good, and says whether y is taken (``ACCEPTED``).

    Reports INPUT_REJECTED where it is not; the step has then made no iteration, else one.
    """


@dataclass(frozen=True)
class Call:
    """Run a block: arrays named by its input ports in, arrays named by its output ports out."""

    block: Block


@dataclass(frozen=True)
class Turns(Call):
    """Run a block of small angles z = d^2 / ``spread``; where they are not small together, take them again.

    Where they are wider than a turn, the angle is given up in the covariance that the block read, and
    COVARIANCE_REPAIRED is reported.
    """

    spread: float


@dataclass(frozen=True)
class Copy:
    """``target = source``, whole arrays."""

    target: str
    source: str


@dataclass(frozen=True)
class Set:
    """``target = value``, one number; ``note`` says why."""

    target: Entry
    value: Value
    note: str = ""


@dataclass(frozen=True)
class Report:
    """Sets a status bit unless a condition holds; ``note`` says why."""

    bit: str
    unless: Condition
    note: str = ""


@dataclass(frozen=True)
class Count:
    """One more in a counter that stops at ``most``, a constant's name."""

    counter: str
    most: str


@dataclass(frozen=True)
class Restart:
    """Set x = x_0, P = diag(P_0) and the monitor's mean to zero."""


@dataclass(frozen=True)
class Wrap:
    """``angle``, an entry of the state, brought back into [-pi, pi) where it has left it: last of a step.

    So a sine or cosine of the state's angle asks for no turns to be taken off, not even after a restart.
    """

    angle: Entry


@dataclass(frozen=True)
class Repeat:
    """At most ``max_iterations`` times; stops once ``change`` (a squared norm) is within tolerance^2, eq. 33.

    In constant time it does not stop before. Reports NOT_CONVERGED where the last pass still moved.
    """

    body: tuple[Call, ...]
    change: str = "change"


@dataclass(frozen=True)
class If:
    """``then`` where the condition holds, else ``otherwise``; blocks of both write the same arrays."""

    condition: Condition
    then: tuple[Node, ...]
    otherwise: tuple[Node, ...] = ()


@dataclass(frozen=True)
class Size:
    """``target``: the sum of squares of ``entries`` and of a whole ``array``, each in the unit 1 / ``per_unit``."""

    target: str
    entries: tuple[Entry, ...]
    array: str
    per_unit: str


@dataclass(frozen=True)
class Seldom:
    """``body`` where the condition holds, which is seldom: C and NumPy keep it in a function ``name``.

    ``size`` is made first.
    """

    name: str
    condition: Condition
    size: Size
    body: tuple[Node, ...]


Node = Guard | Call | Copy | Set | Report | Count | Restart | Wrap | Repeat | If | Seldom


@dataclass(frozen=True)
class FilterStep:
    """One step of a filter: u, y in; x, P updated.

    ``iteration_proof`` is the statement of the proof that iterating is idle, or None where the loop stays.
    ``covariance`` names the array that carries P: ``"P"`` its packed lower triangle, ``"LD"`` the factors of
    P = L D L^T in the same places, D on the diagonal. ``constant_time``: C takes the same path in every step that has
    nothing to report; an iteration then makes all its passes.
    """

    kind: str
    gain: str
    model: StateSpaceModel
    body: tuple[Node, ...]
    iteration_proof: str | None = None
    covariance: str = "P"
    constant_time: bool = False

    @property
    def nodes(self) -> list[Node]:
        """All nodes, those within others too, in the order they run."""
        return list(nodes(self.body))

    @property
    def blocks(self) -> list[Block]:
        """All blocks, in the order they run."""
        return [call.block for call in self.all_of(Call)]

    def all_of(self, kind: type[N]) -> list[N]:
        """Nodes of one kind, in the order they run.

        Parameters
        ----------
        kind : type
            Such as :class:`Call`.
        """
        return [node for node in self.nodes if isinstance(node, kind)]

    def has(self, kind: type[Any]) -> bool:
        """Whether it has a node of this kind.

        Parameters
        ----------
        kind : type
            Such as :class:`Repeat`.
        """
        return bool(self.all_of(kind))


def nodes(body: tuple[Node, ...]) -> Iterator[Node]:
    """All nodes of a body, those within others too, in the order they run.

    Parameters
    ----------
    body : tuple of Node
    """
    for node in body:
        yield node
        if isinstance(node, Repeat | Seldom):
            yield from nodes(node.body)
        elif isinstance(node, If):
            yield from nodes(node.then + node.otherwise)


def wrap_angle(model: StateSpaceModel) -> Wrap:
    """What every step ends with.

    Parameters
    ----------
    model : StateSpaceModel
    """
    return Wrap(Entry("x", model.angle))


def entries_of(node: object) -> Iterator[Entry]:
    """Numbers that a node asks or sets, not those of nodes within it.

    Parameters
    ----------
    node : Node, Condition or Value
    """
    if isinstance(node, Entry):
        yield node
    elif isinstance(node, Set):
        yield from (node.target, *entries_of(node.value))
    elif isinstance(node, Report):
        yield from entries_of(node.unless)
    elif isinstance(node, Wrap):
        yield node.angle
    elif isinstance(node, Seldom | Not):
        yield from entries_of(node.condition)
    elif isinstance(node, Operation | Compare):
        yield from (*entries_of(node.left), *entries_of(node.right))
    elif isinstance(node, All | Either):
        for part in node.conditions:
            yield from entries_of(part)


class BlockBuilder:
    """Collects the inputs, stages and outputs of one block."""

    def __init__(self, name: str, title: str) -> None:
        self.name, self.title = name, title
        self._inputs: list[Port] = []
        self._outputs: list[Port] = []
        self._stages: list[Stage] = []

    def input(self, name: str, names: list[str]) -> list[Any]:
        """Declare an input array; returns its symbolic scalars.

        Parameters
        ----------
        name : str
            The name.
        names : list of str
            Names, in order.
        """
        entries = tuple(ca.SX.sym(scalar) for scalar in names)
        self._inputs.append(Port(name, entries, tuple(names)))
        return list(entries)

    def stage(
        self,
        name: str,
        equation: str,
        meaning: str,
        entries: list[Any],
        names: list[str],
        *,
        scale: str = "row",
        columns: int = 1,
    ) -> list[Any]:
        """Record ``entries`` under the equation's number and give them names; returns the entries.

        Parameters
        ----------
        name : str
            Name of the stage, such as "Pyy".
        equation : str
            Number of the paper's equation; empty if it is not the paper's.
        meaning : str
            The equation in words or letters; empty for a working quantity.
        entries : list of SX
            Row by row.
        names : list of str
            One an entry; it becomes a variable's name in the generated code.
        scale : str, optional
            What the proof judges an error on; see :class:`Stage`.
        columns : int, optional
            How many entries make a row.
        """
        rows = tuple(index // columns for index in range(len(entries)))
        self._stages.append(Stage(name, equation, meaning, tuple(entries), tuple(names), rows, scale))
        return entries

    def lower(
        self, name: str, equation: str, meaning: str, matrix: list[list[Any]], scale: str = "row"
    ) -> list[list[Any]]:
        """Record the lower triangle of a matrix, its entries named ``name_ij``.

        Parameters
        ----------
        name : str
            Name of the stage, and the beginning of its entries'.
        equation : str
            Number of the paper's equation.
        meaning : str
            The equation in words or letters.
        matrix : list of lists, (n, n)
            What is above the diagonal is not read.
        scale : str, optional
            What the proof judges an error on; see :class:`Stage`.

        Returns
        -------
        list of lists, (n, n)
            The matrix, unchanged.
        """
        index = [(i, j) for i in range(len(matrix)) for j in range(i + 1)]
        entries = tuple(matrix[i][j] for i, j in index)
        names = tuple(f"{name}_{i}{j}" for i, j in index)
        self._stages.append(Stage(name, equation, meaning, entries, names, tuple(i for i, _ in index), scale))
        return matrix

    def matrix(
        self, name: str, equation: str, meaning: str, matrix: list[list[Any]], scale: str = "row"
    ) -> list[list[Any]]:
        """Record a full matrix, its entries named ``name_ij``.

        Parameters
        ----------
        name : str
            Name of the stage, and the beginning of its entries'.
        equation : str
            Number of the paper's equation.
        meaning : str
            The equation in words or letters.
        matrix : list of lists, (rows, columns)
        scale : str, optional
            What the proof judges an error on; see :class:`Stage`.

        Returns
        -------
        list of lists, (rows, columns)
            The matrix, unchanged.
        """
        width = len(matrix[0])
        entries = [entry for row in matrix for entry in row]
        names = [f"{name}_{i}{j}" for i in range(len(matrix)) for j in range(width)]
        self.stage(name, equation, meaning, entries, names, scale=scale, columns=width)
        return matrix

    def working(self, equation: str, named: dict[str, Any], suffix: str) -> None:
        """Name intermediates of f or h at one point; they are not compared with the reference.

        Parameters
        ----------
        equation : str
            Number of the paper's equation.
        named : dict
        suffix : str
            End of the names.
        """
        names = [f"{name}_{suffix}" for name in named]
        stage = Stage(
            f"working_{equation}_{suffix}", equation, "", tuple(named.values()), tuple(names), (0,) * len(names), "none"
        )
        self._stages.append(stage)

    def output(self, name: str, entries: list[Any]) -> None:
        """Declare an output array.

        Parameters
        ----------
        name : str
            The array's; entry k is called ``name_k``.
        entries : list of SX
        """
        self._outputs.append(Port(name, tuple(entries), tuple(f"{name}_{k}" for k in range(len(entries)))))

    def build(self) -> Block:
        """Return the block of all that was collected."""
        return Block(self.name, self.title, tuple(self._inputs), tuple(self._outputs), tuple(self._stages))
