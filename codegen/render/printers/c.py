"""C89: blocks become static functions of const locals, the step becomes calls, one loop and one branch."""

from __future__ import annotations

import numpy as np

from codegen.ir.layout import SMALL_ANGLE, Listing, Statement
from codegen.ir.small_angle import coefficients
from codegen.render.printers.expression import horner, unbroken, wrap_line
from codegen.render.printers.flow import FlowPrinter
from codegen.targets.numbers import NumberFormat
from model.filters import FilterStep
from model.filters.conditions import All, Entry
from model.filters.program import (
    Call,
    Copy,
    Count,
    Guard,
    If,
    Node,
    Repeat,
    Report,
    Restart,
    Seldom,
    Set,
    Size,
    Turns,
    Wrap,
)
from model.quantities import Block

INDENT = "    "


class CPrinter(FlowPrinter):
    """Prints listings in one number format.

    >>> from codegen.targets.numbers import FLOAT32
    >>> CPrinter(FLOAT32).format_literal(0.1)
    '0.1f'
    """

    #: What tells a function which filter is meant.
    FILTER = "f"
    #: In constant time choices are made by places in memory.
    BY_PLACE = True

    def __init__(self, numbers: NumberFormat, constant_time: bool = False) -> None:
        self.numbers = numbers
        #: No branch and no choice of a compiler's where a step has nothing to report; one polynomial for every turn.
        self.constant_time = constant_time
        #: Type of a sine and cosine; the port header declares the firmware's, once for all files (MISRA 5.6).
        self.pair = f"pmsm_pair{numbers.tag}"
        #: Numbers and the status that a function of the step has as its own, by what the step calls them.
        self.own: dict[str, str] = {}
        #: The step iterates.
        self.loops = False

    # --- expressions

    def format_literal(self, value: float) -> str:
        """Shortest decimal that reads back to the same bits in the format."""
        rounded = np.float32(value) if self.numbers.suffix else np.float64(value)
        text = str(rounded)
        if not any(mark in text for mark in ".e"):
            text += ".0"
        return text + self.numbers.suffix

    def format_division(self, left: str, right: str) -> str:
        """Spell a division by the port header's macro; empty where the operator does."""
        return f"{self.numbers.divide}({left}, {right})" if self.numbers.divide else ""

    def format_reciprocal(self, argument: str) -> str:
        """Spell 1 / x by the port header's macro; empty where it is a division."""
        return f"{self.numbers.reciprocal}({argument})" if self.numbers.reciprocal else ""

    def format_sqrt(self, argument: str) -> str:
        """Spell a square root."""
        return f"{self.numbers.sqrt}({argument})"

    def format_wrap(self, argument: str) -> str:
        """Spell an angle wrapped into [-pi, pi)."""
        return f"wrap_angle({argument})"

    def format_extreme(self, op: str, left: str, right: str) -> str:
        """Spell the smaller or the larger of two values."""
        return f"{'smaller' if op == 'min' else 'larger'}({left}, {right})"

    def format_select(self, value: str, limit: str, inside: str, outside: str) -> str:
        """Spell one of two values, by a comparison."""
        if self.constant_time and self.BY_PLACE:
            return f"chosen(({value} <= {limit}) ? 1 : 0, {inside}, {outside})"
        return f"({value} <= {limit}) ? {inside} : {outside}"

    # --- statements

    def format_statement(self, listing: Listing, statement: Statement) -> list[str]:
        """One declaration, or the three that sine and cosine take."""
        if statement.pair is None or statement.function is None:
            return [self._declaration(statement.name, self.expression(listing, statement.node))]
        argument, function = listing.names[statement.node], statement.function
        if function is SMALL_ANGLE:
            return self.format_small_angle(statement.pair, argument)
        lines = [f"{INDENT}const {self.pair} {statement.name} = {function.name}({argument});"]
        for name, member in zip(statement.pair, function.members, strict=True):
            if name:
                lines.append(self._declaration(name, f"{statement.name}.{member}"))
        return lines

    def format_small_angle(self, names: tuple[str, str], argument: str) -> list[str]:
        """Nothing yet: see :meth:`_turns`."""
        return []

    def format_turn(self, prefix: str, variable: str) -> str:
        """The polynomial of sinc (``SINC``) or cosm1 (``COSM1``), or a ``WIDE_`` one, its coefficients by name."""
        wide = self.constant_time or prefix.startswith("WIDE_")
        s, c = coefficients(self.numbers.precision, wide=wide)  # how many: n does not change it
        if prefix.endswith("SINC"):
            return f"{horner(f'{prefix}_', len(s), variable)} + {self.format_literal(1.0)}"
        return horner(f"{prefix}_", len(c), variable)

    def _declaration(self, name: str, expression: str) -> str:
        return wrap_line(f"const {self.numbers.real} {name} = {expression};", INDENT, INDENT)

    def format_body(self, listing: Listing, reads: dict[str, str] | None = None) -> list[str]:
        """Sections with their headings.

        ``reads``: declarations of inputs by name, each to stand before the first statement that reads it; left in it
        are those that none reads. GCC keeps what is read early in registers until it spills others for it.
        """
        lines: list[str] = []
        for section in listing.sections:
            if section.heading:
                lines += ["", wrap_line(f"/* --- {section.heading} */", INDENT, "   ")]
            for statement in section.statements:
                if reads:
                    lines += [reads.pop(name) for name in self._inputs_of(listing, statement) if name in reads]
                lines += self.format_statement(listing, statement)
        return lines

    @staticmethod
    def _inputs_of(listing: Listing, statement: Statement) -> list[str]:
        """Names of the inputs in a statement's expression, in its order."""
        found, stack = [], [statement.node]
        while stack:
            index = stack.pop()
            node = listing.graph[index]
            if node.op == "input":
                found.append(node.name)
            elif index == statement.node or index not in listing.names:
                stack += reversed(node.args)
        return found

    # --- functions

    def format_block(self, listing: Listing) -> str:
        """A block as a static function: inputs read where they are used, outputs written last, so they may alias."""
        title = listing.block.title + ("; returns the status" if listing.spreads else "")
        lines = [f"/* {title} */", *self._signature(listing), "{"]
        reads = {
            name: f"{INDENT}const {self.numbers.real} {name} = {port}[{k}];"
            for port, used in listing.used_inputs.items()
            for k, name in used
        }
        body = self.format_body(listing, reads)
        lines += [*(body[1:] if body and not body[0] else body), *reads.values(), ""]
        if listing.spreads:
            lines += self._turns(listing)
        else:
            lines += [line for port in listing.outputs for line in self._written(listing, port)]
        return "\n".join([*lines, *self._unread(listing), "}"])

    @staticmethod
    def _unread(listing: Listing) -> list[str]:
        """Said to the compiler: an input that this machine's equations do not need."""
        return [f"{INDENT}(void){port};" for port, used in listing.used_inputs.items() if not used]

    def _written(self, listing: Listing, port: str) -> list[str]:
        return [
            wrap_line(f"{port}_out[{k}] = {self.reference(listing, node)};", INDENT, INDENT)
            for k, node in enumerate(listing.outputs[port])
        ]

    def _turns(self, listing: Listing) -> list[str]:
        """The outputs of a block of small angles: by polynomials, or by what does it where they are not small together.

        Only the way that is taken writes them: a compiler need not store on the usual one what the other might read. In
        constant time one polynomial does for every angle that is known.
        """
        z, turn = listing.outputs
        (words,) = (port.name for port in listing.block.inputs)
        squares = [self.reference(listing, node) for node in listing.outputs[z]]
        turned = [listing.graph[index] for index in listing.outputs[turn]]
        texts = [self.format_turn(node.op.upper(), self.reference(listing, node.args[0])) for node in turned]
        inline = [wrap_line(f"{turn}_out[{k}] = {text};", INDENT, INDENT) for k, text in enumerate(texts)]
        beyond = f"if ({self.total_turn(listing)} > {'UNKNOWN_TURN' if self.constant_time else 'SMALL_TURN'}) {{"
        if self.constant_time:
            seldom, before, after = [f"return give_up_angle(&{words}[ANGLE_ROW], {turn}_out);"], inline, []
        else:
            seldom = [f"{self.numbers.real} z[{len(squares)}];"]
            seldom += [f"z[{k}] = {text};" for k, text in enumerate(squares)]
            seldom.append(f"return widen(&{words}[ANGLE_ROW], z, {turn}_out, {len(squares)});")
            before, after = [], inline
        seldom = [wrap_line(beyond, INDENT, INDENT), *(INDENT * 2 + line for line in seldom), f"{INDENT}}}"]
        return [*before, *seldom, *after, f"{INDENT}return 0;"]

    def total_turn(self, listing: Listing) -> str:
        """The sum of all z: as none is negative, no turn is wide where it is not."""
        z = next(iter(listing.outputs))
        return " + ".join(self.reference(listing, node) for node in listing.outputs[z])

    def _signature(self, listing: Listing) -> list[str]:
        real, block = self.numbers.real, listing.block
        const = "" if listing.spreads else "const "  # an angle that is given up is given up in P as well
        outputs = block.outputs[1:] if listing.spreads else block.outputs  # the squares stay inside
        args = [unbroken(f"{const}{real} {port.name}[{len(port.entries)}]") for port in block.inputs]
        args += [unbroken(f"{real} {port.name}_out[{len(port.entries)}]") for port in outputs]
        returned = "int" if listing.spreads else "void"
        return wrap_line(f"static {returned} {block.name}({', '.join(args)})", "", INDENT).split("\n")

    def format_helper(self, listing: Listing) -> str:
        """The generated sin_cos (returns a pair) or wrap_angle (returns the angle)."""
        lines = [line for line in self.format_body(listing) if line]
        results = {key: self.expression(listing, nodes[0]) for key, nodes in listing.outputs.items()}
        if len(results) == 1:
            (expression,) = results.values()
            lines.append(f"{INDENT}return {expression};")
        else:
            lines.insert(0, f"{INDENT}{self.pair} result;")
            lines += [wrap_line(f"result.{key} = {text};", INDENT, INDENT) for key, text in results.items()]
            lines.append(f"{INDENT}return result;")
        returned = self.numbers.real if len(results) == 1 else self.pair
        return "\n".join([f"static {returned} {listing.block.name}({self.numbers.real} x)", "{", *lines, "}"])

    # --- the step

    def format_step(self, step: FilterStep) -> list[str]:
        """The control flow of a step; state arrays live in the struct ``f``, the others on the stack."""
        self.loops = step.has(Repeat)
        return self.format_program(step.body)

    def format_program(self, body: tuple[Node, ...], depth: int = 1) -> list[str]:
        """Nodes one after the other."""
        lines: list[str] = []
        for node in body:
            lines += self._format_node(node, depth)
        return lines

    def format_seldom(self, node: Seldom) -> list[str]:
        """The body of the function that a step calls seldom; it has the number it is given by that number's array."""
        self.own = {entry.name: entry.name for entry in node.size.entries if entry.place is not None}
        self.own["status"] = "result"
        lines = [*self._format_size(node.size), *self.format_program(node.body)]
        self.own = {}
        return lines

    def _format_size(self, node: Size) -> list[str]:
        first, *others = (self.format_entry(entry) for entry in node.entries)
        adds = f"{node.target} = {node.target} + size * size;"
        return [
            f"{INDENT}{self.numbers.real} size = {first} * {node.per_unit};",
            f"{INDENT}{self.numbers.real} {node.target} = size * size;",
            *self._declare_status(),
            f"{INDENT}int k;",
            *(line for other in others for line in (f"{INDENT}size = {other} * {node.per_unit};", f"{INDENT}{adds}")),
            f"{INDENT}for (k = 0; k < N_WORDS; k++) {{",
            f"{INDENT * 2}size = {self.format_word(node.array)} * {node.per_unit};",
            f"{INDENT * 2}{adds}",
            f"{INDENT}}}",
        ]

    def _declare_status(self) -> list[str]:
        return [f"{INDENT}int {self.format_status()} = status;"]

    def format_word(self, array: str) -> str:
        """Spell entry k of an array of the struct."""
        return f"{STRUCT_FIELDS[array]}[k]"

    def format_entry(self, entry: Entry) -> str:
        """Spell an entry of an array on the stack or in the struct ``f``, or a field."""
        if entry.place is None:
            return f"f->{entry.name}"
        return self.own.get(entry.name) or f"{STRUCT_FIELDS.get(entry.name, entry.name)}[{entry.place}]"

    def format_counter(self, counter: str) -> str:
        """Spell a field that counts."""
        return f"f->{counter}"

    def format_status(self) -> str:
        """Spell the word that gathers the status bits."""
        return self.own.get("status", "status")

    def _format_call(self, node: Call, pad: str) -> list[str]:
        if not isinstance(node, Turns):
            return [wrap_line(f"{_call(node.block)};", pad, INDENT)]
        block = node.block
        words, _, turn = (STRUCT_FIELDS.get(port.name, port.name) for port in (*block.inputs, *block.outputs))
        return [f"{pad}status |= {block.name}({words}, {turn});"]

    def _format_node(self, node: Node, depth: int) -> list[str]:
        pad = INDENT * depth
        if isinstance(node, Guard):
            return self._format_guard()
        if isinstance(node, Call):
            return self._format_call(node, pad)
        if isinstance(node, Copy):
            return [f"{pad}copy({node.target}, {node.source}, N_STATES);"]
        if isinstance(node, Repeat):
            return self._format_repeat(node, depth)
        if isinstance(node, If):
            return self._format_branch(node, depth)
        return [wrap_line(line, pad, INDENT) for line in self._format_simple(node)]

    def _format_simple(self, node: Set | Report | Count | Restart | Seldom | Wrap) -> list[str]:
        if isinstance(node, Set):
            note = [f"/* {node.note} */"] if node.note else []
            return [*note, f"{self.format_entry(node.target)} = {self.format_value(node.value)};"]
        if isinstance(node, Report):
            return self._format_report(node)
        if isinstance(node, Count):
            counter = self.format_counter(node.counter)
            return [f"{counter} += ({counter} < {node.most}) ? 1 : 0;"]
        if isinstance(node, Restart):
            return [f"restart({self.FILTER});"]
        if isinstance(node, Wrap):
            return self._format_wrapped(self.format_entry(node.angle))
        given = [self.format_entry(entry) for entry in node.size.entries if entry.place is not None]
        call = f"{self.format_status()} = {node.name}({', '.join(['f', self.format_status(), *given])});"
        return [f"if ({self.format_condition(node.condition)}) {{", INDENT + call, "}"]

    def _format_wrapped(self, angle: str) -> list[str]:
        """A branch, so that an angle within its turn, as it nearly always is, is not stored again."""
        if self.constant_time:
            return [f"{angle} = {self.format_wrap(angle)};"]
        return [f"if (!({angle} * {angle} <= INSIDE)) {{", f"{INDENT}{angle} = {self.format_wrap(angle)};", "}"]

    def _format_report(self, node: Report) -> list[str]:
        """A branch where there is more to ask than one comparison, else a choice."""
        condition, bit = self.format_condition(node.unless), self.format_bits((node.bit,))
        if isinstance(node.unless, All):
            return [f"if (!({condition})) {{", f"{INDENT}{self.format_status()} |= {bit};", "}"]
        return [f"{self.format_status()} |= ({condition}) ? 0 : {bit};"]

    def _format_guard(self) -> list[str]:
        """Declarations among it, so that it stands first."""
        return [
            f"{INDENT}int accepted = 0;",
            f"{INDENT}int iterations;",
            *([f"{INDENT}int moving;"] if self.loops else []),
            f"{INDENT}int status = PMSM_INPUT_REJECTED;",
            "",
            f"{INDENT}if (within(u, f->u_max) != 0) {{",
            f"{INDENT * 2}f->u_held[0] = u[0];",
            f"{INDENT * 2}f->u_held[1] = u[1];",
            f"{INDENT * 2}if (within(y, f->y_max) != 0) {{",
            f"{INDENT * 3}accepted = 1;",
            f"{INDENT * 3}status = 0;",
            f"{INDENT * 2}}}",
            f"{INDENT}}}",
            f"{INDENT}iterations = accepted;",
        ]

    def _format_repeat(self, node: Repeat, depth: int) -> list[str]:
        pad, report = INDENT * depth, self.format_bits(("NOT_CONVERGED",))
        again, end = (
            "(moving != 0) && (iterations < f->max_iterations)",
            ["if (moving != 0) {", f"{INDENT}status |= {report};", "}"],
        )
        if self.constant_time:
            again, end = "iterations < f->max_iterations", [f"status |= (moving != 0) ? {report} : 0;"]
        return [
            f"{pad}iterations = 0;",
            f"{pad}do {{",
            *self.format_program(node.body, depth + 1),
            f"{pad}{INDENT}iterations++;",
            f"{pad}{INDENT}moving = ({node.change}[0] <= (f->tolerance * f->tolerance)) ? 0 : 1; /* eq. 33 */",
            f"{pad}}} while ({again});",
            *(pad + line for line in end),
        ]

    def _format_branch(self, node: If, depth: int) -> list[str]:
        pad = INDENT * depth
        otherwise = [f"{pad}}} else {{", *self.format_program(node.otherwise, depth + 1)] if node.otherwise else []
        return [
            f"{pad}if ({self.format_condition(node.condition)}) {{",
            *self.format_program(node.then, depth + 1),
            *otherwise,
            f"{pad}}}",
        ]


#: Arrays that live in the struct, and the field behind a block's argument.
STRUCT_FIELDS = {"x": "f->x", "P": "f->P", "LD": "f->LD", "Q": "f->Q", "R": "f->R", "u": "f->u_held"}


def _call(block: Block) -> str:
    args = [STRUCT_FIELDS.get(port.name, port.name) for port in (*block.inputs, *block.outputs)]
    return f"{block.name}({', '.join(args)})"
