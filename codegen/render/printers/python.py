"""Python: the same listings as straight-line NumPy, working on scalars and on arrays with a trailing batch axis."""

from __future__ import annotations

from codegen.fast.guards import is_monitored, is_turns, is_watched, spread
from codegen.ir.layout import SMALL_ANGLE, Listing, Statement
from codegen.render.printers.expression import ExpressionPrinter, unbroken, wrap_line
from model.filters.program import Call, Copy, IfAccepted, Node, Repeat
from model.quantities import Block

INDENT = "    "


class PythonPrinter(ExpressionPrinter):
    """Prints listings as NumPy functions.

    A literal is written as the double it is. NumPy rounds it to float32 when it meets a float32 array, which
    is the value the C printer writes with an f suffix: one text serves both precisions.
    """

    def format_literal(self, value: float) -> str:
        """Spell a number so that it reads back to the same bits."""
        return repr(float(value))

    def format_sqrt(self, argument: str) -> str:
        """Spell a square root."""
        return f"np.sqrt({argument})"

    def format_wrap(self, argument: str) -> str:
        """Spell an angle wrapped into [-pi, pi)."""
        return f"math.wrap({argument})"

    def format_extreme(self, op: str, left: str, right: str) -> str:
        """Spell the smaller or the larger of two values."""
        return f"_{'smaller' if op == 'min' else 'larger'}({left}, {right})"

    # --- statements

    def format_statement(self, listing: Listing, statement: Statement) -> str:
        """Spell one assignment."""
        if statement.pair is None or statement.function is None:
            return _assignment(statement.name, self.expression(listing, statement.node))
        names = ", ".join(name or "_" for name in statement.pair)
        name = f"turn_{statement.spread:g}" if statement.function is SMALL_ANGLE else statement.function.name
        return f"{INDENT}{names} = math.{name}({listing.names[statement.node]})"

    def format_body(self, listing: Listing) -> list[str]:
        """Spell the sections of a block with their headings."""
        lines: list[str] = []
        for section in listing.sections:
            if section.heading:
                lines += ["", wrap_line(f"# --- {section.heading}", INDENT, "# ")]
            lines += [self.format_statement(listing, statement) for statement in section.statements]
        return lines

    # --- functions

    def format_block(self, listing: Listing) -> str:
        """A block as a function of sequences of scalars (or of arrays, one lane each)."""
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
        """sin_cos or wrap_angle for one precision."""
        results = ", ".join(self.reference(listing, nodes[0]) for nodes in listing.outputs.values())
        constants = [node for node in listing.graph.nodes if node.op == "const" and node.name]
        (argument,) = (port.name for port in listing.block.inputs)
        body = [_assignment(node.name, self.format_literal(node.value)) for node in constants]
        body += [line for line in self.format_body(listing) if line]
        return "\n".join(
            [f"def _{listing.block.name}_{suffix}({argument}):", *body, wrap_line(f"return {results}", INDENT, INDENT)]
        )

    # --- the step

    def format_program(self, body: tuple[Node, ...], accepted: str = "True") -> list[str]:
        """``accepted``: the mask of the lanes that come here."""
        lines: list[str] = []
        for node in body:
            lines += self._format_node(node, accepted)
        return lines

    @staticmethod
    def _format_call(block: Block, accepted: str) -> list[str]:
        if not is_turns(block):
            watched = [f"{INDENT}status = _watch_pivots(LD_pred, f.Q, status)"] if is_watched(block) else []
            return [f"{INDENT}{_call(block)}", *watched]
        (words,), (z, turn) = ([port.name for port in ports] for ports in (block.inputs, block.outputs))
        n = spread(block)
        return [
            f"{INDENT}{_call(block)}",
            f"{INDENT}{words}, {turn}, status = _widen(",
            f"{INDENT * 2}{words}, {z}, {turn}, {accepted}, status, math, math.small_angle_{n:g}, "
            f"SMALL_TURN_{n:g}, UNKNOWN_TURN_{n:g}",
            f"{INDENT})",
        ]

    def _format_node(self, node: Node, accepted: str) -> list[str]:
        if isinstance(node, Call):
            return self._format_call(node.block, accepted)
        if isinstance(node, Copy):
            return [f"{INDENT}{node.target} = {node.source}"]
        if isinstance(node, Repeat):
            return self._format_repeat(node)
        assert isinstance(node, IfAccepted)
        return self._format_branch(node)

    def _format_repeat(self, node: Repeat) -> list[str]:
        """A lane that has converged is frozen, so every lane sees the scalar loop's bits."""
        (call,) = node.body
        outputs = [port.name for port in call.block.outputs]
        kept = [name for name in outputs if name != node.change]
        pad = INDENT * 2
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
            f"{pad}active = active & accepted & moving & (iterations < f.max_iterations)",
            f"{pad}if not np.any(active):",
            f"{pad}{INDENT}break",
            f"{INDENT}iterations = np.where(accepted, iterations, 0)[()]",
            f"{INDENT}status = status | np.where(accepted & moving, NOT_CONVERGED, 0)[()]",
        ]

    def _format_branch(self, node: IfAccepted) -> list[str]:
        (otherwise,) = node.otherwise
        assert isinstance(otherwise, Call)
        return [
            *self.format_program(node.then, "accepted"),
            *([f"{INDENT}_average(f, nis[0], accepted)"] if is_monitored(node) else []),
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
