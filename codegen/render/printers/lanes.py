"""C for many filters at once: each block a loop over lanes whose body is the scalar block, line by line.

The same listings and the same expressions in the same order, so every lane has the bits of the scalar form; the
loops hold no call and no branch, so a compiler puts them into vector registers. What only some lanes do (a rejected
input, an iterate that has converged) is done by all and kept where it counts.
"""

from __future__ import annotations

import textwrap

from codegen.ir.layout import Listing
from codegen.render.printers.c import INDENT, STRUCT_FIELDS, CPrinter
from codegen.render.printers.expression import unbroken, wrap_line
from codegen.targets.numbers import NumberFormat
from model.filters import FilterStep
from model.filters.conditions import ACCEPTED, All, Condition, Either, Entry, Not
from model.filters.program import (
    Call,
    Copy,
    Guard,
    If,
    Node,
    Repeat,
    Report,
    Seldom,
    Set,
    Turns,
    Wrap,
    entries_of,
)
from model.quantities import Block

#: Ports that their callers give an array to read and another to write: the loop of eq. 33, the regulators, the motor,
#: the square wave, the resistance.
COPIED = frozenset({"x_j", "integrator", "s", "duty", "v", "injection", "resistance"})


class LanesPrinter(CPrinter):
    """Prints the same expressions as :class:`CPrinter`, arrays of ``lanes`` around them."""

    FILTER, BY_PLACE = "f, lane", False

    def __init__(self, numbers: NumberFormat, states: int, struct: str = "", constant_time: bool = False) -> None:
        super().__init__(numbers, constant_time)
        self.states, self.struct = states, struct
        #: Some wide turns are not for lanes whose measurement is rejected.
        self.skips = False
        #: Functions that a step needs besides its blocks.
        self.functions: list[str] = []
        #: The type that holds one number of every lane.
        self.array = f"lanes{numbers.tag}"

    # --- functions

    def format_block(self, listing: Listing) -> str:
        """A block as a loop over lanes; its arrays must differ, which ``__restrict`` tells the compiler.

        Parameters
        ----------
        listing : Listing
        """
        read, written = ({port.name for port in ports} for ports in (listing.block.inputs, listing.block.outputs))
        assert not written & read or written & COPIED, "what is read and written needs two arrays from its caller"
        body = [
            f"{INDENT}const {self.numbers.real} {name} = {port}[{k}].of[lane];"
            for port, used in listing.used_inputs.items()
            for k, name in used
        ]
        body += [*self.format_body(listing), ""]
        for port, nodes in listing.outputs.items():
            body += [
                wrap_line(f"{port}_out[{k}].of[lane] = {self.reference(listing, node)};", INDENT, INDENT)
                for k, node in enumerate(nodes)
            ]
        turned = bool(listing.spreads)
        if turned:
            test = f"{self.total_turn(listing)} > {'UNKNOWN_TURN' if self.constant_time else 'SMALL_TURN'}"
            body.append(wrap_line(f"wide |= ({test}) ? 1 : 0;", INDENT, INDENT))
        return "\n".join(
            [
                f"/* {listing.block.title} */",
                *self._signature(listing),
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
        """The polynomials for all lanes; those that are wide are mended afterwards.

        Parameters
        ----------
        names : tuple of two str
            What sinc and cosm1 are called.
        argument : str
            Text of z.
        """
        return [
            self._declaration(name, self.format_turn(prefix, argument))
            for name, prefix in zip(names, ("SINC", "COSM1"), strict=True)
        ]

    def _signature(self, listing: Listing) -> list[str]:
        block = listing.block
        args = [unbroken(f"const {self.array} *__restrict {port.name}") for port in block.inputs]
        args += [unbroken(f"{self.array} *__restrict {port.name}_out") for port in block.outputs]
        returned = "int" if listing.spreads else "void"
        return wrap_line(f"static {returned} {block.name}({', '.join(args)})", "", INDENT).split("\n")

    # --- the step

    def format_step(self, step: FilterStep) -> list[str]:
        """The calls of a step; what is between them is printed as functions, loops over lanes (:attr:`functions`).

        Parameters
        ----------
        step : FilterStep
        """
        self.skips = any(
            isinstance(node, Turns) for branch in step.nodes if isinstance(branch, If) for node in branch.then
        )
        lines: list[str] = []
        work: list[tuple[Condition | None, Node]] = []
        for node in step.body:
            if isinstance(node, Set | Report | Seldom):
                work.append((None, node))
                continue
            lines += self._format_work(work)
            work = []
            lines += self._format_wrap_lanes(node) if isinstance(node, Wrap) else self._format_node(node, 1)
            if isinstance(node, If):  # a lane comes to one branch alone: the order of what they do is free
                work += [(node.condition, part) for part in node.then if isinstance(part, Set)]
        return [*lines, *self._format_work(work)]

    def _format_wrap_lanes(self, node: Wrap) -> list[str]:
        """A loop over lanes, which becomes a function, and its call."""
        angle = self.format_entry(node.angle)
        self.functions.append(
            "\n".join(
                [
                    "/* The angle back within a turn. */",
                    f"static void keep_within_turn({self.struct} *__restrict f)",
                    "{",
                    f"{INDENT}int lane;",
                    f"{INDENT}for (lane = 0; lane < LANES; lane++) {{",
                    f"{INDENT * 2}{angle} = {self.format_wrap(angle)};",
                    f"{INDENT}}}",
                    "}",
                ]
            )
        )
        return [f"{INDENT}keep_within_turn(f);"]

    def _format_work(self, work: list[tuple[Condition | None, Node]]) -> list[str]:
        """A loop over lanes, which becomes a function, and its call."""
        if not work:
            return []
        seldom = next((node for _, node in work if isinstance(node, Seldom)), None)
        name = "finish_step" if seldom else "watch_pivots"
        written = {node.target.name for _, node in work if isinstance(node, Set) and node.target.place is not None}
        arguments = {"f": f"{self.struct} *__restrict f"}
        for array in _arrays([node for _, node in work]):
            const = "" if array in written else "const "
            arguments[array] = f"{const}{self.array} *__restrict {array}"
        if any(where for where, _ in work):
            arguments["rejected"] = "const int *__restrict rejected"
        notes = [node.note for _, node in work if isinstance(node, Set | Report) and node.note]
        if seldom:
            self.functions.append(self._seldom_function(seldom))
        lines = [
            wrap_line(f"/* {' '.join(notes)} */", "", " * "),
            wrap_line(f"static void {name}({', '.join(map(unbroken, arguments.values()))})", "", INDENT),
            "{",
            *([f"{INDENT}int special[LANES];", f"{INDENT}int any = 0;"] if seldom else []),
            f"{INDENT}int lane;",
            *(line for where, node in work for line in self._lane_loop(node, where)),
            *(self._seldom_lanes(seldom) if seldom else []),
            "}",
        ]
        self.functions.append("\n".join(lines))
        return [f"{INDENT}{name}({', '.join(arguments)});"]

    def _lane_loop(self, node: Node, where: Condition | None) -> list[str]:
        lines = [wrap_line(line, INDENT * 2, INDENT) for line in self._format_lane(node, where)]
        return [f"{INDENT}for (lane = 0; lane < LANES; lane++) {{", *lines, f"{INDENT}}}"]

    def _format_lane(self, node: Node, where: Condition | None) -> list[str]:
        """What one lane does, without a branch."""
        if isinstance(node, Set):
            target, value = self.format_entry(node.target), self.format_value(node.value)
            if where is None:
                return [f"{target} = {value};"]
            assert where == ACCEPTED
            name, real = node.target.name, self.numbers.real
            return [
                f"const {real} {name}_before = {target};",
                f"const {real} {name}_after = {value};",
                f"{target} = (rejected[lane] != 0) ? {name}_before : {name}_after;",
            ]
        if isinstance(node, Report):
            assert isinstance(node.unless, All)
            lines, clear = self._apart("clear", node.unless.conditions, " & ")
            status, bit = self.format_status(), self.format_bits((node.bit,))
            return [*lines, f"const int clear = {clear};", f"{status} |= (clear != 0) ? 0 : {bit};"]
        assert isinstance(node, Seldom)
        assert isinstance(node.condition, Either)
        lines, unusual = self._apart("unusual", node.condition.conditions, " | ")
        return [*lines, f"special[lane] = {unusual};", "any |= special[lane];"]

    def _apart(self, name: str, conditions: tuple[Condition, ...], sign: str) -> tuple[list[str], str]:
        """Each condition with a name of its own, 1 or 0, and all of them together: a compiler sees no branch."""
        lines, names = [], []
        for k, condition in enumerate(conditions):
            choice = "1 : 0"
            if isinstance(condition, Not):
                condition, choice = condition.condition, "0 : 1"
            names.append(f"{name}_{k}")
            lines.append(f"const int {name}_{k} = ({self.format_condition(condition)}) ? {choice};")
        return lines, sign.join(names)

    @staticmethod
    def _seldom_lanes(node: Seldom) -> list[str]:
        given = [f"{entry.name}[{entry.place}].of[lane]" for entry in node.size.entries if entry.place is not None]
        return [
            f"{INDENT}if (any != 0) {{",
            f"{INDENT * 2}for (lane = 0; lane < LANES; lane++) {{",
            f"{INDENT * 3}if (special[lane] != 0) {{",
            f"{INDENT * 4}{node.name}({', '.join(['f', *given, 'lane'])});",
            f"{INDENT * 3}}}",
            f"{INDENT * 2}}}",
            f"{INDENT}}}",
        ]

    def _seldom_function(self, node: Seldom) -> str:
        given = [f"{self.numbers.real} {entry.name}" for entry in node.size.entries if entry.place is not None]
        return "\n".join(
            [
                "/* Sets the remaining status bits of a lane whose step was not ordinary, counts repairs, and "
                "restarts it if need be: as\n * in the scalar form. */",
                f"static void {node.name}({', '.join([f'{self.struct} *__restrict f', *given, 'int lane'])})",
                "{",
                *self.format_seldom(node),
                "}",
            ]
        )

    def _declare_status(self) -> list[str]:
        return []

    def format_word(self, array: str) -> str:
        """Spell entry k of an array of the struct.

        Parameters
        ----------
        array : str
            The array's name in the step.
        """
        return f"{STRUCT_FIELDS[array]}[k].of[lane]"

    def format_entry(self, entry: Entry) -> str:
        """Spell a lane's number: of an array on the stack or in the struct, or of a field.

        Parameters
        ----------
        entry : Entry
        """
        if entry.place is None:
            return f"f->{entry.name}[0].of[lane]"
        return self.own.get(entry.name) or f"{STRUCT_FIELDS.get(entry.name, entry.name)}[{entry.place}].of[lane]"

    def format_counter(self, counter: str) -> str:
        """Spell a lane's counter.

        Parameters
        ----------
        counter : str
            Name of the field.
        """
        return f"f->{counter}[lane]"

    def format_status(self) -> str:
        """Spell the word that gathers a lane's status bits."""
        return "f->status[lane]"

    def _format_call(self, node: Call, pad: str) -> list[str]:
        block = node.block
        if not isinstance(node, Turns):
            return [wrap_line(f"{_call(block)};", pad, INDENT)]
        words, z, turn = (STRUCT_FIELDS.get(port.name, port.name) for port in (*block.inputs, *block.outputs))
        arguments = [f"&{words}[ANGLE_ROW]", z, turn, str(len(block.outputs[0].entries))]
        arguments += ["NULL" if words.startswith("f->") else "rejected"] if self.skips else []
        call = f"{'give_up_angle' if self.constant_time else 'widen'}_lanes({', '.join(arguments)}, f->status);"
        return [f"{pad}if ({_call(block)} != 0) {{", pad + INDENT + call, f"{pad}}}"]

    def _format_node(self, node: Node, depth: int) -> list[str]:
        pad = INDENT * depth
        if isinstance(node, Guard):
            return [f"{pad}const int any_rejected = guard(f, u, y, rejected);", ""]
        if isinstance(node, Copy):
            return [f"{pad}copy({node.target}, {node.source}, {self.states});"]
        if isinstance(node, If) and node.condition == ACCEPTED:
            return self._format_accepted(node, depth)
        return super()._format_node(node, depth)

    def _format_accepted(self, node: If, depth: int) -> list[str]:
        """What is taken of the other branch where the measurement is rejected; numbers are set afterwards."""
        pad, calls = INDENT * depth, tuple(part for part in node.then if not isinstance(part, Set))
        (otherwise,) = node.otherwise
        assert isinstance(otherwise, Call)
        outputs = {port.name: len(port.entries) for port in otherwise.block.outputs}
        return [
            *self.format_program(calls, depth),
            f"{pad}if (any_rejected != 0) {{",
            wrap_line(_call(otherwise.block, "other_", frozenset(outputs)) + ";", pad + INDENT, INDENT),
            *(
                f"{pad}{INDENT}take({STRUCT_FIELDS.get(name, name)}, other_{name}, rejected, {length});"
                for name, length in outputs.items()
            ),
            f"{pad}}}",
        ]

    def _format_repeat(self, node: Repeat, depth: int) -> list[str]:
        """A lane that has converged is frozen, so every lane ends where the scalar loop leaves it."""
        pad = INDENT * depth
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


def _arrays(nodes: list[Node]) -> list[str]:
    """Arrays on the stack of which numbers are used, in order."""
    found: dict[str, None] = {}
    for entry in (entry for node in nodes for entry in entries_of(node)):
        if entry.place is not None and entry.name not in STRUCT_FIELDS:
            found[entry.name] = None
    return list(found)


def lane_arrays(body: tuple[Node, ...]) -> dict[str, int]:
    """Arrays of the step that do not live in the struct, and their lengths.

    Parameters
    ----------
    body : tuple of Node
        The step's; what lies within its nodes counts too.
    """
    sizes: dict[str, int] = {}
    for node in body:
        if isinstance(node, Call):
            sizes |= {p.name: len(p.entries) for p in node.block.outputs if p.name not in STRUCT_FIELDS}
        elif isinstance(node, Repeat):
            for call in node.body:
                outputs = {p.name: len(p.entries) for p in call.block.outputs}
                sizes |= {name: size for name, size in outputs.items() if name != node.change}
                sizes |= {f"new_{name}": size for name, size in outputs.items()}
        elif isinstance(node, If):
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
