"""C for many filters at once: each block a loop over lanes whose body is the scalar block, line by line.

The same listings and the same expressions in the same order, so every lane has the bits of the scalar form; the
loops hold no call and no branch, so a compiler puts them into vector registers. What only some lanes do (a rejected
input, an iterate that has converged) is done by all and kept where it counts.
"""

from __future__ import annotations

import textwrap

from codegen.layout import SMALL_ANGLE, Listing
from codegen.printers.c import INDENT, STRUCT_FIELDS, CPrinter
from codegen.printers.expression import unbroken, wrap_line
from codegen.targets import Target
from model.filters.program import Call, Copy, IfAccepted, Node, Repeat
from model.quantities import Block


class LanesPrinter(CPrinter):
    """Prints the same expressions as :class:`CPrinter`, arrays of ``lanes`` around them."""

    def __init__(self, target: Target, states: int) -> None:
        super().__init__(target)
        self.states = states

    # --- functions

    def format_block(self, listing: Listing) -> str:
        """A block as a loop over lanes; its arrays must differ, which ``__restrict`` tells the compiler."""
        read, written = ({port.name for port in ports} for ports in (listing.block.inputs, listing.block.outputs))
        assert not written & read or "x_j" in written, "the loop of eq. 33 alone gives arrays of their own"
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
        turned = [s for section in listing.sections for s in section.statements if s.function is SMALL_ANGLE]
        if turned:
            test = " | ".join(f"({listing.names[s.node]} > SMALL_TURN)" for s in turned)
            body.append(wrap_line(f"wide |= {test};", INDENT, INDENT))
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
                *(self._widen_some(listing, len(turned)) if turned else []),
                "}",
            ]
        )

    @staticmethod
    def _widen_some(listing: Listing, count: int) -> list[str]:
        z, turn = listing.outputs
        return [f"{INDENT}if (wide != 0) {{", f"{INDENT * 2}widen_lanes({z}_out, {turn}_out, {count});", f"{INDENT}}}"]

    def _signature(self, block: Block) -> list[str]:
        args = [unbroken(f"const lanes *__restrict {port.name}") for port in block.inputs]
        args += [unbroken(f"lanes *__restrict {port.name}_out") for port in block.outputs]
        return wrap_line(f"static void {block.name}({', '.join(args)})", "", INDENT).split("\n")

    # --- the step

    def _format_node(self, node: Node, depth: int) -> list[str]:
        pad = INDENT * depth
        if isinstance(node, Call):
            return [wrap_line(_call(node.block), pad, INDENT)]
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
            wrap_line(_call(otherwise.block, "other_", frozenset(outputs)), pad + INDENT, INDENT),
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
            f"{pad}begin_iterating(f, active);",
            f"{pad}do {{",
            wrap_line(_call(call.block, "new_", frozenset(outputs)), pad + INDENT, INDENT),
            *(
                f"{pad}{INDENT}take({name}, new_{name}, active, {length});"
                for name, length in outputs.items()
                if name != node.change
            ),
            f"{pad}}} while (go_on(f, new_{node.change}, rejected, active) != 0); /* eq. 33 */",
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
    return f"{block.name}({', '.join(args)});"
