"""C for many filters at once: each block a loop over lanes whose body is the scalar block, line by line.

The same listings and the same expressions in the same order, so every lane has the bits of the scalar form; the
loops hold no call and no branch, so a compiler puts them into vector registers. What only some lanes do (a rejected
input, an iterate that has converged) is done by all and kept where it counts.
"""

from __future__ import annotations

import textwrap

from codegen.fast.guards import is_turns, is_watched
from codegen.ir.layout import Listing
from codegen.render.printers.c import INDENT, STRUCT_FIELDS, CPrinter
from codegen.render.printers.expression import unbroken, wrap_line
from codegen.render.printers.targets import Target
from model.filters.program import Call, Copy, IfAccepted, Node, Repeat
from model.quantities import Block

#: Ports that their callers give an array to read and another to write: the loop of eq. 33, the regulators, the motor.
COPIED = frozenset({"x_j", "integrator", "s"})


class LanesPrinter(CPrinter):
    """Prints the same expressions as :class:`CPrinter`, arrays of ``lanes`` around them."""

    def __init__(self, target: Target, states: int, skips: bool = False) -> None:
        super().__init__(target)
        self.states = states
        #: Some wide turns are not for lanes whose measurement is rejected.
        self.skips = skips
        #: The type that holds one number of every lane.
        self.array = f"lanes{target.tag}"

    # --- functions

    def format_block(self, listing: Listing) -> str:
        """A block as a loop over lanes; its arrays must differ, which ``__restrict`` tells the compiler."""
        read, written = ({port.name for port in ports} for ports in (listing.block.inputs, listing.block.outputs))
        assert not written & read or written & COPIED, "what is read and written needs two arrays from its caller"
        body = [
            f"{INDENT}const {self.target.real} {name} = {port}[{k}].of[lane];"
            for port, used in listing.used_inputs.items()
            for k, name in used
        ]
        body += [*self.format_body(listing), ""]
        for port, nodes in listing.outputs.items():
            body += [
                wrap_line(f"{port}_out[{k}].of[lane] = {self.reference(listing, node)};", INDENT, INDENT)
                for k, node in enumerate(nodes)
            ]
        turned = is_turns(listing.block)
        if turned:
            test = f"{self.total_turn(listing)} > SMALL_TURN"
            body.append(wrap_line(f"wide |= ({test}) ? 1 : 0;", INDENT, INDENT))
        return "\n".join(
            [
                f"/* {listing.block.title} */",
                *self._signature(listing.block),
                "{",
                f"{INDENT}int lane;",
                *([f"{INDENT}int wide = 0;"] if turned else []),
                f"{INDENT}for (lane = 0; lane < LANES; lane++) {{",
                *(textwrap.indent(line, INDENT) for line in body),
                f"{INDENT}}}",
                *([f"{INDENT}return wide;"] if turned else []),
                *self._unread(listing),
                "}",
            ]
        )

    def format_small_angle(self, names: tuple[str, str], argument: str) -> list[str]:
        """The polynomials for all lanes; those that are wide are mended afterwards."""
        return [
            self._declaration(name, self.format_turn(prefix, argument))
            for name, prefix in zip(names, ("SINC", "COSM1"), strict=True)
        ]

    def _signature(self, block: Block) -> list[str]:
        args = [unbroken(f"const {self.array} *__restrict {port.name}") for port in block.inputs]
        args += [unbroken(f"{self.array} *__restrict {port.name}_out") for port in block.outputs]
        returned = "int" if is_turns(block) else "void"
        return wrap_line(f"static {returned} {block.name}({', '.join(args)})", "", INDENT).split("\n")

    # --- the step

    def _format_call(self, block: Block, pad: str) -> list[str]:
        if not is_turns(block):
            watched = [f"{pad}watch_pivots(LD_pred, f->Q, f->status);"] if is_watched(block) else []
            return [wrap_line(f"{_call(block)};", pad, INDENT), *watched]
        words, z, turn = (STRUCT_FIELDS.get(port.name, port.name) for port in (*block.inputs, *block.outputs))
        arguments = [f"&{words}[ANGLE_ROW]", z, turn, str(len(block.outputs[0].entries))]
        arguments += ["NULL" if words.startswith("f->") else "rejected"] if self.skips else []
        return [
            f"{pad}if ({_call(block)} != 0) {{",
            f"{pad}{INDENT}widen_lanes({', '.join(arguments)}, f->status);",
            f"{pad}}}",
        ]

    def _format_node(self, node: Node, depth: int) -> list[str]:
        pad = INDENT * depth
        if isinstance(node, Call):
            return self._format_call(node.block, pad)
        if isinstance(node, Copy):
            return [f"{pad}copy({node.target}, {node.source}, {self.states});"]
        if isinstance(node, Repeat):
            return self._format_repeat(node, pad)
        assert isinstance(node, IfAccepted)
        (otherwise,) = node.otherwise
        assert isinstance(otherwise, Call)
        outputs = {port.name: len(port.entries) for port in otherwise.block.outputs}
        return [
            *self.format_program(node.then, depth),
            f"{pad}if (any_rejected != 0) {{",
            wrap_line(_call(otherwise.block, "other_", frozenset(outputs)) + ";", pad + INDENT, INDENT),
            *(
                f"{pad}{INDENT}take({STRUCT_FIELDS.get(name, name)}, other_{name}, rejected, {length});"
                for name, length in outputs.items()
            ),
            f"{pad}}}",
        ]

    @staticmethod
    def _format_repeat(node: Repeat, pad: str) -> list[str]:
        """A lane that has converged is frozen, so every lane ends where the scalar loop leaves it."""
        (call,) = node.body
        outputs = {port.name: len(port.entries) for port in call.block.outputs}
        return [
            f"{pad}begin_iterating(f, active, moving);",
            f"{pad}do {{",
            wrap_line(_call(call.block, "new_", frozenset(outputs)) + ";", pad + INDENT, INDENT),
            *(
                f"{pad}{INDENT}take({name}, new_{name}, active, {length});"
                for name, length in outputs.items()
                if name != node.change
            ),
            f"{pad}}} while (go_on(f, new_{node.change}, rejected, active, moving) != 0); /* eq. 33 */",
            f"{pad}judge_convergence(f, rejected, moving);",
        ]


def lane_arrays(body: tuple[Node, ...]) -> dict[str, int]:
    """Arrays of the step that do not live in the struct, and their lengths."""
    sizes: dict[str, int] = {}
    for node in body:
        if isinstance(node, Call):
            sizes |= {p.name: len(p.entries) for p in node.block.outputs if p.name not in STRUCT_FIELDS}
        elif isinstance(node, Repeat):
            for call in node.body:
                outputs = {p.name: len(p.entries) for p in call.block.outputs}
                sizes |= {name: size for name, size in outputs.items() if name != node.change}
                sizes |= {f"new_{name}": size for name, size in outputs.items()}
        elif isinstance(node, IfAccepted):
            sizes |= lane_arrays(node.then)
            (otherwise,) = node.otherwise
            assert isinstance(otherwise, Call)
            sizes |= {f"other_{p.name}": len(p.entries) for p in otherwise.block.outputs}
    return sizes


def _call(block: Block, prefix: str = "", prefixed: frozenset[str] = frozenset()) -> str:
    args = [STRUCT_FIELDS.get(port.name, port.name) for port in block.inputs]
    args += [
        f"{prefix}{port.name}" if port.name in prefixed else STRUCT_FIELDS.get(port.name, port.name)
        for port in block.outputs
    ]
    return f"{block.name}({', '.join(args)})"
