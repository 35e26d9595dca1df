"""What a step costs: operations counted on the graph, cycles computed from published figures."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from codegen.layout import Listing
from model.filters.program import Call, IfAccepted, Node, Repeat

#: Cycles of one addition or multiplication in compiled float code: typical (published compiler listings).
CYCLES_PER_OPERATION = 2.5
#: fastRTS cycles with call: division, square root, sine and cosine together.
CYCLES = {"div": 25, "sqrt": 29, "sincos": 44}


@dataclass(frozen=True)
class Cost:
    """Worst case of one step: every iteration taken. ``words`` are 16-bit words of the state struct."""

    operations: dict[str, int]
    words: int

    @property
    def cycles(self) -> int:
        """Estimate for C28x + FPU32, from published cycles; nothing here was run on the chip."""
        ops = self.operations
        fixed = sum(CYCLES[name] * ops.get(name, 0) for name in CYCLES)
        wrap = 9 * ops.get("wrap", 0)  # the generated wrap: 9 additions and multiplications
        return round(CYCLES_PER_OPERATION * (ops.get("add", 0) + ops.get("mul", 0) + wrap) + fixed + 60)


def step_cost(body: tuple[Node, ...], listings: dict[str, Listing], max_iterations: int, n: int) -> Cost:
    """Count a step, with the loop taken ``max_iterations`` times and the measurement accepted."""
    total = _count(body, listings, max_iterations)
    floats = n + n * (n + 1) // 2 + n + 2 + n + n + 3 + 2
    return Cost({name: total[name] for name in ("add", "mul", "div", "sqrt", "sincos", "wrap")}, 2 * floats + 2)


def _count(body: tuple[Node, ...], listings: dict[str, Listing], max_iterations: int) -> Counter[str]:
    total: Counter[str] = Counter()
    for node in body:
        if isinstance(node, Call):
            total += listings[node.block.name].operations()
        elif isinstance(node, Repeat):
            once = _count(node.body, listings, max_iterations)
            total += Counter({name: count * max_iterations for name, count in once.items()})
        elif isinstance(node, IfAccepted):
            total += _count(node.then, listings, max_iterations)
    return total
