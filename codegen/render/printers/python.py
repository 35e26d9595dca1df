"""Python: the same listings as straight-line NumPy, working on scalars and on arrays with a trailing batch axis."""

from __future__ import annotations

from codegen.ir.layout import SMALL_ANGLE, Listing, Statement
from codegen.render.printers.expression import unbroken, wrap_line
from codegen.render.printers.flow import FlowPrinter
from model.filters import FilterStep
from model.filters.conditions import ACCEPTED, All, Condition, Either, Entry, Not, Reported
from model.filters.program import Call, Copy, Count, Guard, If, Node, Repeat, Report, Restart, Seldom, Set, Turns, Wrap
from model.quantities import Block

INDENT = "    "


class PythonPrinter(FlowPrinter):
    """Prints listings as NumPy functions.

    A literal is written as the double it is. NumPy rounds it to float32 when it meets a float32 array, which
    is the value the C printer writes with an f suffix: one text serves both precisions.
    """

    #: The step iterates, and the name of the array that carries P.
    loops, covariance = False, "P"
    AND, OR, NOT, BIT, ACCEPTED = "&", "|", "~", "", "accepted"

    def __init__(self, constant_time: bool = False) -> None:
        #: Every turn by the polynomial of wide ones, and every pass of an iteration: what C does in constant time.
        self.constant_time = constant_time

    def format_literal(self, value: float) -> str:
        """Spell a number so that it reads back to the same bits.

        Parameters
        ----------
        value : float
        """
        return repr(float(value))

    def format_sqrt(self, argument: str) -> str:
        """Spell a square root.

        Parameters
        ----------
        argument : str
            Text of an expression.
        """
        return f"np.sqrt({argument})"

    def format_wrap(self, argument: str) -> str:
        """Spell an angle wrapped into [-pi, pi).

        Parameters
        ----------
        argument : str
            Text of an expression, rad.
        """
        return f"math.wrap({argument})"

    def format_extreme(self, op: str, left: str, right: str) -> str:
        """Spell the smaller or the larger of two values.

        Parameters
        ----------
        op : {"min", "max"}
        left, right : str
            Text of two expressions.
        """
        return f"_{'smaller' if op == 'min' else 'larger'}({left}, {right})"

    def format_select(self, value: str, limit: str, inside: str, outside: str) -> str:
        """Spell one of two values, by a comparison, lane by lane.

        Parameters
        ----------
        value, limit, inside, outside : str
            Text of four expressions.
        """
        return f"np.where({value} <= {limit}, {inside}, {outside})[()]"

    # --- statements

    def format_statement(self, listing: Listing, statement: Statement) -> str:
        """Spell one assignment.

        Parameters
        ----------
        listing : Listing
            The block that it is of.
        statement : Statement
        """
        if statement.pair is None or statement.function is None:
            return _assignment(statement.name, self.expression(listing, statement.node))
        names = ", ".join(name or "_" for name in statement.pair)
        turn = f"{'wide_turn' if self.constant_time else 'turn'}_{statement.spread:g}"
        name = turn if statement.function is SMALL_ANGLE else statement.function.name
        return f"{INDENT}{names} = math.{name}({listing.names[statement.node]})"

    def format_body(self, listing: Listing) -> list[str]:
        """Spell the sections of a block with their headings.

        Parameters
        ----------
        listing : Listing
        """
        lines: list[str] = []
        for section in listing.sections:
            if section.heading:
                lines += ["", wrap_line(f"# --- {section.heading}", INDENT, "# ")]
            lines += [self.format_statement(listing, statement) for statement in section.statements]
        return lines

    # --- functions

    def format_block(self, listing: Listing) -> str:
        """A block as a function of sequences of scalars (or of arrays, one lane each).

        Parameters
        ----------
        listing : Listing
        """
        block = listing.block
        arguments = ", ".join([*(port.name for port in block.inputs), "math", "stages=None"])
        lines = [f"def {block.name}({arguments}):", f'{INDENT}"""{block.title}."""']
        for port in block.inputs:
            lines += self._format_input(port.name, len(port.entries), listing.used_inputs[port.name])
        lines += [*self.format_body(listing), ""]
        if any(stage.scale != "none" for stage in block.stages):
            lines += self._format_stages(listing)
        results = [self._tuple(listing, nodes) for nodes in listing.outputs.values()]
        if len(results) == 1:
            lines.append(wrap_line(f"return {results[0]}", INDENT, INDENT))
        else:
            lines += [
                f"{INDENT}return (",
                *(wrap_line(f"{text},", INDENT * 2, INDENT) for text in results),
                f"{INDENT})",
            ]
        return "\n".join(lines)

    @staticmethod
    def _format_input(port: str, length: int, used: list[tuple[int, str]]) -> list[str]:
        if len(used) == length and length > 1:
            text = ", ".join(name for _, name in used)
            return [wrap_line(f"({text}){unbroken(f' = {port}')}", INDENT, INDENT)]
        return [f"{INDENT}{name} = {port}[{k}]" for k, name in used]

    def _format_stages(self, listing: Listing) -> list[str]:
        lines = [f"{INDENT}if stages is not None:"]
        for stage in listing.block.stages:
            if stage.scale != "none":
                text = f'stages["{stage.name}"] = {self._tuple(listing, listing.stages[stage.name])}'
                lines.append(wrap_line(text, INDENT * 2, INDENT))
        return lines

    def _tuple(self, listing: Listing, nodes: list[int]) -> str:
        return f"({', '.join(self._result(listing, node) for node in nodes)},)"

    def _result(self, listing: Listing, node: int) -> str:
        """A number that leaves a block takes the format with it: selected lane by lane it would become a double."""
        text = self.reference(listing, node)
        return f"math.dtype({text})" if listing.graph[node].op == "const" else text

    def format_helper(self, listing: Listing, suffix: str) -> str:
        """sin_cos or wrap_angle for one precision.

        Parameters
        ----------
        listing : Listing
        suffix : str
            End of the function's name: "f32" or "f64".
        """
        results = ", ".join(self.reference(listing, nodes[0]) for nodes in listing.outputs.values())
        constants = [node for node in listing.graph.nodes if node.op == "const" and node.name]
        (argument,) = (port.name for port in listing.block.inputs)
        body = [_assignment(node.name, self.format_literal(node.value)) for node in constants]
        body += [line for line in self.format_body(listing) if line]
        return "\n".join(
            [f"def _{listing.block.name}_{suffix}({argument}):", *body, wrap_line(f"return {results}", INDENT, INDENT)]
        )

    # --- the step

    def format_step(self, step: FilterStep) -> list[str]:
        """The control flow of a step, masks in place of branches.

        Parameters
        ----------
        step : FilterStep
        """
        self.loops, self.covariance = step.has(Repeat), step.covariance
        return self.format_program(step.body)

    def format_program(self, body: tuple[Node, ...], where: str = "") -> list[str]:
        """Nodes one after the other.

        Parameters
        ----------
        body : tuple of Node
        where : str, optional
            Name of the mask of the lanes that come here; none: all do.
        """
        return [line for node in body for line in self._format_node(node, where)]

    def format_seldom(self, node: Seldom) -> list[str]:
        """The body of the function that sees to the lanes in which something seldom happened.

        Parameters
        ----------
        node : Seldom
        """
        first, *others = (self.format_entry(entry) for entry in node.size.entries)
        adds = f"{node.size.target} = {node.size.target} + size * size"
        return [
            wrap_line(f"{unbroken('ordinary = (')}{self._negated(node.condition)})", INDENT, INDENT),
            f"{INDENT}if np.all(ordinary):",
            f"{INDENT * 2}return x, {node.size.array}, status",
            f"{INDENT}size = {first} * {node.size.per_unit}",
            f"{INDENT}{node.size.target} = size * size",
            f"{INDENT}for entry in ({', '.join([*others, '*' + node.size.array])}):",
            f"{INDENT * 2}size = entry * {node.size.per_unit}",
            f"{INDENT * 2}{adds}",
            *self.format_program(node.body, "~ordinary"),
            f"{INDENT}return x, {node.size.array}, status",
        ]

    def _negated(self, condition: Condition) -> str:
        """That a condition does not hold, without the ~ that Python's own truths do not have."""
        if isinstance(condition, Either):
            return " & ".join(f"({self._negated(part)})" for part in condition.conditions)
        if isinstance(condition, Not):
            return self.format_condition(condition.condition)
        assert isinstance(condition, Reported)
        return f"(status & {self.format_bits(condition.bits)}) == 0"

    def format_entry(self, entry: Entry) -> str:
        """Spell an entry of an array, or a field.

        Parameters
        ----------
        entry : Entry
        """
        if entry.place is None:
            return f"f.{entry.name}"
        return f"{_ARGUMENTS.get(entry.name, entry.name)}[{entry.place}]"

    def _format_node(self, node: Node, where: str) -> list[str]:
        if isinstance(node, Guard):
            return self._format_guard()
        if isinstance(node, Call):
            return self._format_call(node, where)
        if isinstance(node, Copy):
            return [f"{INDENT}{node.target} = {node.source}"]
        if isinstance(node, Repeat):
            return self._format_repeat(node)
        if isinstance(node, If) and node.condition == ACCEPTED:
            return self._format_branch(node)
        if isinstance(node, If):
            assert not node.otherwise
            mask = (
                f"{where} & ({self.format_condition(node.condition)})"
                if where
                else self.format_condition(node.condition)
            )
            return [f"{INDENT}where = {mask}", *self.format_program(node.then, "where")]
        return [wrap_line(line, INDENT, INDENT) for line in self._format_simple(node, where)]

    def _format_simple(self, node: Set | Report | Count | Restart | Seldom | Wrap, where: str) -> list[str]:
        if isinstance(node, Set):
            return self._format_set(node, where)
        if isinstance(node, Report):
            return self._format_report(node, where)
        if isinstance(node, Count):
            counter = f"f.{node.counter}"
            return [f"{counter} = np.where({where} & ({counter} < {node.most}), {counter} + 1, {counter})[()]"]
        if isinstance(node, Restart):
            return [f"x, {self.covariance} = _restart(f, x, {self.covariance}, {where})"]
        if isinstance(node, Wrap):
            name, place = node.angle.name, node.angle.place
            assert place is not None
            wrapped = self.format_wrap(f"{name}[{place}]")
            return [f"{name} = (*{name}[:{place}], {wrapped}, *{name}[{place + 1}:])"]
        given = [entry.name for entry in node.size.entries if entry.place is not None]
        results = f"x, {node.size.array}, status"
        arguments = ", ".join(["f", "x", node.size.array, *given, "status"])
        return [f"{results} = _{node.name}({arguments})"]

    def _format_report(self, node: Report, where: str) -> list[str]:
        """``where``: none, or the opposite of a mask."""
        note, held = [f"# {node.note}"] if node.note else [], self.format_condition(node.unless)
        if isinstance(node.unless, All):
            note, held = [*note, f"{unbroken('clear = (')}{held})"], "clear"
        held = f"{where.removeprefix('~')} | ({held})" if where else held
        return [*note, f"status = status | np.where({held}, 0, {node.bit})[()]"]

    def _format_set(self, node: Set, where: str) -> list[str]:
        target, value = self.format_entry(node.target), self.format_value(node.value)
        note = [f"# {node.note}"] if node.note else []
        if node.target.place is not None:  # arrays are tuples: this one has one entry
            assert not where
            assert node.target.place == 0
            return [*note, f"{node.target.name} = ({value},)"]
        return [*note, f"{target} = " + (f"np.where({where}, {value}, {target})[()]" if where else value)]

    def _format_call(self, node: Call, where: str) -> list[str]:
        block = node.block
        if not isinstance(node, Turns):
            return [f"{INDENT}{_call(block)}"]
        (words,), (z, turn) = ([port.name for port in ports] for ports in (block.inputs, block.outputs))
        n, function, limits = node.spread, "_widen", "math.wide_turn_{0:g}, SMALL_TURN_{0:g}, UNKNOWN_TURN_{0:g}"
        if self.constant_time:
            function, limits = "_give_up_angle", "UNKNOWN_TURN_{0:g}"
        return [
            f"{INDENT}{_call(block)}",
            f"{INDENT}{words}, {turn}, status = {function}(",
            f"{INDENT * 2}{words}, {z}, {turn}, {where or 'True'}, status, math, {limits.format(n)}",
            f"{INDENT})",
        ]

    def _format_guard(self) -> list[str]:
        """A rejected measurement is zero: what the blocks make of it is not kept, and warns of nothing."""
        return [
            f"{INDENT}u_good = _within(u, f.u_max)",
            f"{INDENT}accepted = u_good & _within(y, f.y_max)",
            f"{INDENT}u_held = _select(u_good, u, f.u_held)",
            f"{INDENT}y = _select(accepted, y, (math.dtype(0), math.dtype(0)))",
            f"{INDENT}iterations = np.where(accepted, {0 if self.loops else 1}, 0)[()]",
            f"{INDENT}status = np.where(accepted, 0, INPUT_REJECTED)[()]",
        ]

    def _format_repeat(self, node: Repeat) -> list[str]:
        """A lane that has converged is frozen, so every lane sees the scalar loop's bits."""
        (call,) = node.body
        outputs = [port.name for port in call.block.outputs]
        kept = [name for name in outputs if name != node.change]
        pad, ends = INDENT * 2, "" if self.constant_time else "moving & "
        return [
            f"{INDENT}active = np.ones(np.shape(accepted), bool)[()]  # all lanes take the first pass",
            f"{INDENT}moving = active",
            *(
                f"{INDENT}{port.name} = (math.dtype(0),) * {len(port.entries)}"
                for port in call.block.outputs
                if port.name in kept and port.name != "x_j"
            ),
            f"{INDENT}while True:",
            f"{pad}iterate = None if stages is None else {{}}",
            pad + _call(call.block, stages="iterate", prefix="new_"),
            *(f"{pad}{name} = _select(active, new_{name}, {name})" for name in kept),
            f"{pad}if stages is not None:",
            f'{pad}{INDENT}stages.setdefault("iterates", []).append(iterate)',
            f"{pad}iterations = iterations + np.where(active, 1, 0)[()]",
            f"{pad}moving = np.where(active, ~(new_{node.change}[0] <= f.tolerance * f.tolerance), moving)[()]",
            f"{pad}active = active & accepted & {ends}(iterations < f.max_iterations)",
            f"{pad}if not np.any(active):",
            f"{pad}{INDENT}break",
            f"{INDENT}iterations = np.where(accepted, iterations, 0)[()]",
            f"{INDENT}status = status | np.where(accepted & moving, NOT_CONVERGED, 0)[()]",
        ]

    def _format_branch(self, node: If) -> list[str]:
        (otherwise,) = node.otherwise
        assert isinstance(otherwise, Call)
        return [
            *self.format_program(node.then, "accepted"),
            f"{INDENT}if not np.all(accepted):",
            f"{INDENT}{INDENT}{_call(otherwise.block, prefix='coast_')}",
            *(
                f"{INDENT}{INDENT}{name} = _select(accepted, {name}, coast_{name})"
                for name in (port.name for port in otherwise.block.outputs)
            ),
        ]


def _assignment(name: str, expression: str) -> str:
    line = f"{INDENT}{name} = {expression}"
    # No break between the name and its parenthesis: without one the statement would end there.
    wrapped = wrap_line(f"{unbroken(name + ' = (')}{expression})", INDENT, INDENT)
    return line if len(line) <= 110 else wrapped


#: Where a block's argument comes from: the filter's tuning, or a local of the step.
_ARGUMENTS = {"Q": "f.Q", "R": "f.R", "u": "u_held"}


def _call(block: Block, stages: str = "stages", prefix: str = "") -> str:
    args = [_ARGUMENTS.get(port.name, port.name) for port in block.inputs]
    results = ", ".join(prefix + port.name for port in block.outputs)
    return f"{results} = {block.name}({', '.join([*args, 'math', stages])})"
