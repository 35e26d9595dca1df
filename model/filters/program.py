"""The control flow of a step: calls of pure blocks, one bounded loop, one branch on the input guard.

Small on purpose: C prints it with ``for`` and ``if``, NumPy with masks over a batch, and both compute the
same bits. Arrays are known by name; ``x, P`` are the state, ``Q, R`` the tuning, ``u, y`` the inputs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from model.machines.state_space import StateSpaceModel
from model.quantities import Block, Port, Stage


@dataclass(frozen=True)
class Call:
    """Run a block: arrays named by its input ports in, arrays named by its output ports out."""

    block: Block


@dataclass(frozen=True)
class Copy:
    """``target = source``, whole arrays."""

    target: str
    source: str


@dataclass(frozen=True)
class Repeat:
    """At most ``max_iterations`` times; stops once ``change`` (a squared norm) is within tolerance^2, eq. 33."""

    body: tuple[Call, ...]
    change: str = "change"


@dataclass(frozen=True)
class IfAccepted:
    """``then`` where the measurement was accepted, else ``otherwise``; both write the same arrays."""

    then: tuple[Node, ...]
    otherwise: tuple[Node, ...]


Node = Call | Copy | Repeat | IfAccepted


@dataclass(frozen=True)
class FilterStep:
    """One step of a filter: u, y in; x, P updated.

    ``iteration_proof`` is the statement of the proof that iterating is idle, or None where the loop stays.
    ``covariance`` names the array that carries P: ``"P"`` its packed lower triangle, ``"LD"`` the factors of
    P = L D L^T in the same places, D on the diagonal.
    """

    kind: str
    gain: str
    model: StateSpaceModel
    body: tuple[Node, ...]
    iteration_proof: str | None = None
    covariance: str = "P"

    @property
    def guarded(self) -> bool:
        """It watches itself: floors of P told, a monitor of the innovations, a restart. The literal form does not."""
        return self.covariance == "LD"

    @property
    def blocks(self) -> list[Block]:
        """All blocks, in the order they run."""
        return _blocks(self.body)


def _blocks(body: tuple[Node, ...]) -> list[Block]:
    found: list[Block] = []
    for node in body:
        if isinstance(node, Call):
            found.append(node.block)
        elif isinstance(node, Repeat):
            found += _blocks(node.body)
        elif isinstance(node, IfAccepted):
            found += _blocks(node.then) + _blocks(node.otherwise)
    return found


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

        ``columns`` entries make a row, so row-major order is expected; see :class:`Stage` for ``scale``.
        """
        rows = tuple(index // columns for index in range(len(entries)))
        self._stages.append(Stage(name, equation, meaning, tuple(entries), tuple(names), rows, scale))
        return entries

    def lower(
        self, name: str, equation: str, meaning: str, matrix: list[list[Any]], scale: str = "row"
    ) -> list[list[Any]]:
        """Record the lower triangle of a matrix, its entries named ``name_ij``."""
        index = [(i, j) for i in range(len(matrix)) for j in range(i + 1)]
        entries = tuple(matrix[i][j] for i, j in index)
        names = tuple(f"{name}_{i}{j}" for i, j in index)
        self._stages.append(Stage(name, equation, meaning, entries, names, tuple(i for i, _ in index), scale))
        return matrix

    def matrix(
        self, name: str, equation: str, meaning: str, matrix: list[list[Any]], scale: str = "row"
    ) -> list[list[Any]]:
        """Record a full matrix, its entries named ``name_ij``."""
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
        """Declare an output array."""
        self._outputs.append(Port(name, tuple(entries), tuple(f"{name}_{k}" for k in range(len(entries)))))

    def build(self) -> Block:
        """Return the block of all that was collected."""
        return Block(self.name, self.title, tuple(self._inputs), tuple(self._outputs), tuple(self._stages))
