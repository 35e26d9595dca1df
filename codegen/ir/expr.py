"""Arithmetic on graph nodes, with zeros and ones left out as it goes, and blocks made of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from codegen.ir.constants import folded
from codegen.ir.graph import Graph
from model.filters.program import BlockBuilder
from model.quantities import Block, Port, Stage


@dataclass(frozen=True)
class Expr:
    """A node of a graph that can be calculated with.

    >>> g = Graph()
    >>> x = Expr(g, g.input("x"))
    >>> (0.0 * x).is_zero(), (x + 0.0) == x, (x - x * 1.0).is_zero()
    (True, True, True)
    """

    graph: Graph
    node: int

    @property
    def value(self) -> float | None:
        """The number, if this is one."""
        item = self.graph[self.node]
        return item.value if item.op == "const" else None

    def is_zero(self) -> bool:
        """Structurally zero."""
        return self.value == 0.0

    def _coerce(self, other: Expr | float) -> Expr:
        return other if isinstance(other, Expr) else Expr(self.graph, self.graph.const(float(other)))

    def apply(self, op: str, *others: Expr) -> Expr:
        """An operation as it stands, without simplification.

        Parameters
        ----------
        op : str
            Such as "add"; see :class:`codegen.ir.graph.Node`.
        *others : Expr
            The operands behind this one, of the same graph.
        """
        return Expr(self.graph, self.graph.op(op, self.node, *(other.node for other in others)))

    def __add__(self, other: Expr | float) -> Expr:
        b = self._coerce(other)
        if self.is_zero():
            return b
        return self if b.is_zero() else self.apply("add", b)

    def __sub__(self, other: Expr | float) -> Expr:
        b = self._coerce(other)
        if b.is_zero():
            return self
        if self.node == b.node:
            return self._coerce(0.0)
        return -b if self.is_zero() else self.apply("sub", b)

    def __neg__(self) -> Expr:
        item = self.graph[self.node]
        if item.op == "neg":
            return Expr(self.graph, item.args[0])
        return self.apply("neg")

    def __mul__(self, other: Expr | float) -> Expr:
        b = self._coerce(other)
        if self.is_zero() or b.is_zero():
            return self._coerce(0.0)
        for one, rest in ((self, b), (b, self)):
            if one.value in (1.0, -1.0):
                return rest if one.value == 1.0 else -rest
        if self.value is not None and b.value is not None:
            known = folded(self.graph, [self.node, b.node])
            return Expr(self.graph, self.graph.const(known.value, known.name, known.formula))
        return self.apply("mul", b)

    def __truediv__(self, other: Expr | float) -> Expr:
        b = self._coerce(other)
        if self.is_zero() or b.value == 1.0:
            return self
        return self.apply("div", b)

    def __radd__(self, other: float) -> Expr:
        return self + other

    def __rsub__(self, other: float) -> Expr:
        return self._coerce(other) - self

    def __rmul__(self, other: float) -> Expr:
        return self * other

    def __rtruediv__(self, other: float) -> Expr:
        return self._coerce(other) / self


def sum_of(terms: list[Expr]) -> Expr:
    """Left to right.

    Parameters
    ----------
    terms : list of Expr
        One or more.
    """
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total


def dot(a: list[Expr], b: list[Expr]) -> Expr:
    """a^T b.

    Parameters
    ----------
    a, b : list of Expr
        Of one length, at least 1.
    """
    return sum_of([p * q for p, q in zip(a, b, strict=True)])


@dataclass(frozen=True)
class GraphBlock(Block):
    """A block whose entries are nodes of ``graph`` already, not symbols of a tape.

    ``last`` names stages that are printed behind the others, in this order: the first brings with it whatever it is
    made of. A value is then computed where it is used, and a processor need not keep it. ``hints`` are names for values
    that come to be used more than once and that no stage names; they order nothing.
    """

    graph: Graph
    last: tuple[str, ...] = ()
    hints: tuple[tuple[str, Expr], ...] = ()

    @property
    def operations(self) -> frozenset[str]:
        """The operations its outputs are made of."""
        results = (entry.node for port in self.outputs for entry in port.entries)
        return frozenset(self.graph[index].op for index in self.graph.reachable(results))

    @property
    def roots(self) -> list[int]:
        """Nodes that must survive every pass as values: outputs and compared stages."""
        stages = (entry.node for stage in self.stages if stage.scale != "none" for entry in stage.entries)
        return [*(entry.node for port in self.outputs for entry in port.entries), *stages]


class GraphBuilder(BlockBuilder):
    """Collects a block like its parent, with :class:`Expr` for CasADi's scalars."""

    def __init__(self, name: str, title: str) -> None:
        super().__init__(name, title)
        self.graph = Graph()
        self._hints: list[tuple[str, Expr]] = []

    def const(self, value: float, name: str = "", formula: str = "") -> Expr:
        """A number; one with a name keeps it in print.

        Parameters
        ----------
        value : float
        name : str, optional
            Identifier in the generated code.
        formula : str, optional
            What the number is made of, for the comment beside it.
        """
        return Expr(self.graph, self.graph.const(value, name, formula))

    def input(self, name: str, names: list[str]) -> list[Any]:
        """Declare an input array; returns its scalars.

        Parameters
        ----------
        name : str
            The array's.
        names : list of str
            Its entries', in order.
        """
        entries = tuple(Expr(self.graph, self.graph.input(scalar)) for scalar in names)
        self._inputs.append(Port(name, entries, tuple(names)))
        return list(entries)

    def suggest(self, equation: str, named: dict[str, Expr]) -> None:
        """Names for whatever of these survives the passes as a value of its own.

        Parameters
        ----------
        equation : str
            Number of the paper's equation.
        named : dict of str to Expr
            Constants among them are left out.
        """
        kept = {name: value for name, value in named.items() if value.value is None}
        rows = (0,) * len(kept)
        label = f"working_{equation}_{len(self._stages)}"
        self._stages.append(Stage(label, equation, "", tuple(kept.values()), tuple(kept), rows, "none"))

    def hint(self, named: dict[str, Expr]) -> None:
        """Names for whatever of these is used more than once; unlike a stage they order no statement.

        Parameters
        ----------
        named : dict of str to Expr
            Constants among them are left out.
        """
        self._hints += [(name, value) for name, value in named.items() if value.value is None]

    def build(self, last: tuple[str, ...] = ()) -> GraphBlock:
        """The block, without input arrays that no output depends on; ``last`` as :class:`GraphBlock` says.

        Parameters
        ----------
        last : tuple of str, optional
            Names of stages.
        """
        block = super().build()
        roots = [entry.node for port in block.outputs for entry in port.entries]
        needed = {self.graph[index].name for index in self.graph.reachable(roots)}
        inputs = tuple(port for port in block.inputs if needed & set(port.names))
        return GraphBlock(
            block.name, block.title, inputs, block.outputs, block.stages, self.graph, last, tuple(self._hints)
        )
