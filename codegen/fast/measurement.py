"""A measurement as the filters take it, in the block that made it and in a later one."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from codegen.fast.factored import Matrix
from codegen.ir.expr import Expr, GraphBuilder

Vector = list[Expr]


@dataclass(frozen=True)
class Measurement:
    """A measurement as the filter takes it: rows of H L (2, n), noise (2, 2), innovation (2,).

    ``floor`` bounds the variance of the second from below once the first is known; ``where`` tells the frame.
    """

    rows: Matrix
    noise: Matrix
    innovation: Vector
    floor: Expr
    where: str

    def _labelled(self) -> dict[str, Expr]:
        rows = {f"HL_{k}{c}": entry for k, row in enumerate(self.rows) for c, entry in enumerate(row)}
        return rows | {"noise_00": self.noise[0][0], "noise_10": self.noise[1][0], "noise_11": self.noise[1][1]}

    def carried(self, inputs: Collection[str]) -> dict[str, dict[str, Expr]]:
        """The entries that a later block must be given, by array and name: all but numbers and these ``inputs``."""
        found: dict[str, dict[str, Expr]] = {}
        for label, entry in self._labelled().items():
            node = entry.graph[entry.node]
            if node.op != "const" and node.name not in inputs:
                found.setdefault(label.split("_")[0], {})[label] = entry
        return found

    def in_block(self, b: GraphBuilder, given: dict[str, Expr], innovation: Vector, floor: Expr) -> Measurement:
        """The same in another block, ``given`` there what is carried, and inputs, by name."""

        def place(label: str, entry: Expr) -> Expr:
            node = entry.graph[entry.node]
            if node.op == "const":
                return b.const(node.value, node.name, node.formula)
            return given[label if label in given else node.name]

        at = {label: place(label, entry) for label, entry in self._labelled().items()}
        rows = [[at[f"HL_{k}{c}"] for c in range(len(row))] for k, row in enumerate(self.rows)]
        noise = [[at["noise_00"], at["noise_10"]], [at["noise_10"], at["noise_11"]]]
        return Measurement(rows, noise, innovation, floor, "")
