"""The guards in a step: their limits, and which blocks have something to say besides numbers."""

from __future__ import annotations

from codegen.fast.turns import OPERATIONS
from codegen.ir.expr import GraphBlock
from model.filters.program import Call, IfAccepted, Node, Repeat
from model.quantities import Block

#: The step restarts where a state, a word of the covariance or the monitor's mean is beyond it. Its square is far from
#: the largest float, and a motor's states in SI units are far from it; the sine of an angle turned so fast is a number.
SANE_LIMIT = 1e9

#: The divergence monitor as shipped: normalised innovation squared (two measurements: 2 expected), mean over 64 steps,
#: from innovations ten times as large as the filter expects. Dead time or R 30 % off make up to 175 of it, a lost rotor
#: thousands.
NIS_MAX, NIS_WEIGHT = 200.0, 1.0 / 64.0


def is_watched(block: Block) -> bool:
    """It leaves pivots that are bounded from below, and the guard's ``check``."""
    return any(port.name == "check" for port in block.outputs)


def is_turns(block: Block) -> bool:
    """It computes small angles, and says when one of them is not."""
    return isinstance(block, GraphBlock) and not block.operations.isdisjoint(OPERATIONS)


def spread(block: Block) -> float:
    """The n of a block of small angles, z = d^2 / n."""
    assert isinstance(block, GraphBlock)
    turned = (entry.node for port in block.outputs for entry in port.entries)
    (n,) = {block.graph[node].args[1] for node in turned if block.graph[node].op in OPERATIONS}
    return block.graph[n].value


def is_monitored(node: Node) -> bool:
    """It leaves the normalised innovation squared, ``nis``."""
    if isinstance(node, Call):
        return any(port.name == "nis" for port in node.block.outputs)
    if isinstance(node, Repeat):
        return any(is_monitored(call) for call in node.body)
    return isinstance(node, IfAccepted) and any(is_monitored(part) for part in node.then)
