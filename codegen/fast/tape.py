"""f or h of a model as a tape that can be replayed: at a point, along a direction, in a turned frame."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca

from codegen.fast.frame import AngleFinder, Frame
from codegen.fast.split import Split, SplitAlgebra
from codegen.ir.expr import Expr, GraphBuilder
from codegen.ir.graph import read_tape
from model.machines.state_space import StateSpaceModel
from model.quantities import Constant

Vector = list[Expr]


@dataclass(frozen=True)
class Tape:
    """f or h with its named intermediates, ready to be replayed."""

    model: StateSpaceModel
    arguments: list[Any]
    values: list[Any]
    named: dict[str, Any]

    @property
    def constants(self) -> list[Constant]:
        """The model's constants that the tape reads."""
        return self.model.constants

    @property
    def inputs(self) -> list[str]:
        """Names of the inputs."""
        return [state.name for state in self.model.states]

    def at(self, b: GraphBuilder, inputs: list[Vector]) -> Vector:
        """The function at a point."""
        return [Expr(b.graph, node) for node in read_tape(b.graph, self.function, self._nodes(b, inputs))[0]]

    def frame(self, b: GraphBuilder, inputs: list[Vector]) -> Frame | None:
        """The frame that follows the first angle the function takes a sine of."""
        finder = AngleFinder(b.graph)
        read_tape(finder, self.function, self._nodes(b, inputs))
        return Frame.at(Expr(b.graph, finder.angles[0])) if finder.angles else None

    def _nodes(self, b: GraphBuilder, inputs: list[Vector]) -> list[list[int]]:
        constants = [b.graph.const(k.value, k.name, k.formula) for k in self.constants]
        return [*([value.node for value in vector] for vector in inputs), constants]

    @cached_property
    def function(self) -> Any:
        """The CasADi function behind the tape."""
        symbols = ca.vertcat(*(constant.symbol for constant in self.constants))
        named = ca.vertcat(*self.named.values()) if self.named else ca.SX(0, 1)
        return ca.Function(
            "tape", [*self.arguments, symbols], [ca.densify(ca.vertcat(*self.values)), ca.densify(named)]
        )

    def replay(
        self, algebra: SplitAlgebra, inputs: list[list[Split]], constants: list[Split]
    ) -> tuple[list[Split], dict[str, Split]]:
        """Carry out the tape in an algebra."""
        values, named = read_tape(algebra, self.function, [*inputs, constants])
        return values, dict(zip(self.named, named, strict=True))


def suggest_parts(b: GraphBuilder, equation: str, named: dict[str, Split], algebra: SplitAlgebra, column: int) -> None:
    """Names for the parts of named quantities, and for how far the column turns an angle."""
    known = {part.base.node: name for name, part in reversed(named.items())}
    for angle, z in algebra.turns:
        name = known.get(angle.base.node, "angle")
        labels = (f"sinc_{name}_{column}", f"cosm1_{name}_{column}")
        halves = dict(zip(labels, algebra.halves(z), strict=True))
        b.suggest(equation, {f"z_{name}_{column}": z, **halves})
        sine = angle.odd * halves[labels[0]]
        b.hint({f"sind_{name}_{column}": sine, f"D_sind_{name}_{column}": algebra.variance * sine})
        b.hint({f"n_D_sind_{name}_{column}": algebra.q * sine})
    b.hint({f"n_D_{column}": algebra.q})
    for name, part in named.items():
        b.hint({f"n_D_odd_{name}_{column}": algebra.q * part.odd})
        if part.total != part.base:
            b.hint({f"total_{name}_{column}": part.total})
        b.suggest(equation, {name: part.base, f"even_{name}_{column}": part.even, f"odd_{name}_{column}": part.odd})
