"""Expressions in infix notation, with only the parentheses that keep the order of operations.

The order is the tape's: neither C nor Python reassociates, so the text fixes the bits.
"""

from __future__ import annotations

import re
import textwrap

from codegen.ir.layout import Listing

WIDTH = 110

_PRECEDENCE = {"add": 1, "sub": 1, "mul": 2, "div": 2, "neg": 3}
_SYMBOL = {"add": "+", "sub": "-", "mul": "*", "div": "/"}


class ExpressionPrinter:
    """Infix text of a node; a language says how it writes literals, square roots, wrapping and selection."""

    def format_literal(self, value: float) -> str:
        """Spell a number so that it reads back to the same bits.

        Parameters
        ----------
        value : float
        """
        raise NotImplementedError

    def format_division(self, left: str, right: str) -> str:
        """Spell a division as a call; empty where the language's operator does.

        Parameters
        ----------
        left, right : str
            Text of two expressions.
        """
        return ""

    def format_sqrt(self, argument: str) -> str:
        """Spell a square root.

        Parameters
        ----------
        argument : str
            Text of an expression.
        """
        raise NotImplementedError

    def format_wrap(self, argument: str) -> str:
        """Spell an angle wrapped into [-pi, pi).

        Parameters
        ----------
        argument : str
            Text of an expression, rad.
        """
        raise NotImplementedError

    def format_extreme(self, op: str, left: str, right: str) -> str:
        """The smaller (``min``) or larger (``max``) of two; the second one where they do not compare.

        Parameters
        ----------
        op : {"min", "max"}
        left, right : str
            Text of two expressions.
        """
        raise NotImplementedError

    def format_select(self, value: str, limit: str, inside: str, outside: str) -> str:
        """``inside`` where value <= limit, else, and where they do not compare, ``outside``.

        Parameters
        ----------
        value, limit, inside, outside : str
            Text of four expressions.
        """
        raise NotImplementedError

    def reference(self, listing: Listing, node: int) -> str:
        """The node's name if it has one, else its expression.

        Parameters
        ----------
        listing : Listing
            The block that the node is of.
        node : int
        """
        return listing.names[node] if node in listing.names else self.expression(listing, node)

    def expression(self, listing: Listing, node: int) -> str:
        """The operation of ``node``, its unnamed arguments written out.

        Parameters
        ----------
        listing : Listing
            The block that the node is of.
        node : int
        """
        return self._format(listing, node, expand=True)[0]

    def _format(self, listing: Listing, index: int, expand: bool = False) -> tuple[str, int]:
        """Text and precedence (4: an atom; 0: a choice, which binds least)."""
        node = listing.graph[index]
        if index in listing.names and not (expand and node.op not in {"input", "const"}):
            return listing.names[index], 4
        if node.op == "const":
            text = self.format_literal(node.value)
            return text, (3 if text.startswith("-") else 4)
        args = [self._format(listing, arg) for arg in node.args]
        if node.op == "div" and (call := self.format_division(args[0][0], args[1][0])):
            return call, 4
        if node.op in _SYMBOL:
            return self._format_binary(node.op, args)
        if node.op == "neg":
            return "-" + _parenthesised(args[0], 3), 3
        if node.op == "sqrt":
            return self.format_sqrt(args[0][0]), 4
        if node.op == "wrap":
            return self.format_wrap(args[0][0]), 4
        if node.op in {"min", "max"}:
            return self.format_extreme(node.op, args[0][0], args[1][0]), 4
        if node.op == "select":
            return self.format_select(*(text for text, _ in args)), 0
        raise ValueError(f"no printer for operation '{node.op}'")

    @staticmethod
    def _format_binary(op: str, args: list[tuple[str, int]]) -> tuple[str, int]:
        precedence = _PRECEDENCE[op]
        left = _parenthesised(args[0], precedence)
        right = _parenthesised(args[1], precedence + 1)  # a right operand of equal rank keeps its parentheses
        return f"{left} {_SYMBOL[op]} {right}", precedence


def _parenthesised(operand: tuple[str, int], least: int) -> str:
    text, precedence = operand
    return text if precedence >= least else f"({text})"


def unbroken(text: str) -> str:
    """Text that :func:`wrap_line` keeps on one line.

    Parameters
    ----------
    text : str
    """
    return text.replace(" ", "\0")


def wrap_line(text: str, indent: str, hanging: str) -> str:
    """Break a long statement at blanks, but not around * and / nor inside short parentheses; continuations hang.

    Parameters
    ----------
    text : str
        A statement, on one line.
    indent : str
        Blanks before its first line.
    hanging : str
        Blanks that the others have more.
    """
    if len(indent) + len(text) <= WIDTH:
        return (indent + text).replace("\0", " ")
    glued = re.sub(r"(?<!\0)\([^()]{1,60}\)", lambda match: unbroken(match.group()), text)
    glued = glued.replace(" * ", unbroken(" * ")).replace(" / ", unbroken(" / "))
    lines = textwrap.wrap(
        glued,
        WIDTH,
        initial_indent=indent,
        subsequent_indent=indent + hanging,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return "\n".join(lines).replace("\0", " ")
