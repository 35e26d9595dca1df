"""Numbers and conditions of a step's control flow in infix; a language says how it spells the parts."""

from __future__ import annotations

from codegen.render.printers.expression import ExpressionPrinter
from model.filters.conditions import (
    Accepted,
    All,
    Compare,
    Condition,
    Entry,
    Label,
    Name,
    Not,
    Number,
    Operation,
    Reported,
    Value,
    Whole,
)


class FlowPrinter(ExpressionPrinter):
    """What C, its lane form and Python print of a step in the same way."""

    #: Between conditions that all hold, and between such of which one does.
    AND, OR = "&&", "||"
    #: Before a condition that does not hold.
    NOT = "!"
    #: Before the name of a status bit, or of another number of the port header.
    BIT = "PMSM_"
    #: The measurement is taken.
    ACCEPTED = "accepted != 0"

    def format_entry(self, entry: Entry) -> str:
        """Spell an entry of an array, or a field.

        Parameters
        ----------
        entry : Entry
        """
        raise NotImplementedError

    def format_value(self, value: Value) -> str:
        """Spell a number of the flow.

        Parameters
        ----------
        value : Value
        """
        if isinstance(value, Entry):
            return self.format_entry(value)
        if isinstance(value, Name):
            return value.name
        if isinstance(value, Number):
            return self.format_literal(value.value)
        if isinstance(value, Whole):
            return str(value.value)
        if isinstance(value, Label):
            return self.BIT + value.name
        left, right = self.format_value(value.left), self.format_value(value.right)
        if value.sign == "*" and isinstance(value.left, Operation) and value.left.sign != "*":
            left = f"({left})"
        if isinstance(value.right, Operation) and not (value.right.sign == "*" and value.sign != "*"):
            right = f"({right})"
        return f"{left} {value.sign} {right}"

    def format_condition(self, condition: Condition) -> str:
        """Spell a truth; more than one comparison stand in parentheses.

        Parameters
        ----------
        condition : Condition
        """
        if isinstance(condition, Accepted):
            return self.ACCEPTED
        if isinstance(condition, Compare):
            return f"{self.format_value(condition.left)} {condition.sign} {self.format_value(condition.right)}"
        if isinstance(condition, Reported):
            return f"({self.format_status()} & {self.format_bits(condition.bits)}) != 0"
        if isinstance(condition, Not):
            return f"{self.NOT}({self.format_condition(condition.condition)})"
        sign = self.AND if isinstance(condition, All) else self.OR
        parts = [self._enclosed(part) for part in condition.conditions]
        return f" {sign} ".join(parts)

    def _enclosed(self, condition: Condition) -> str:
        text = self.format_condition(condition)
        return text if isinstance(condition, Not) else f"({text})"

    def format_bits(self, bits: tuple[str, ...]) -> str:
        """Spell a mask of status bits.

        Parameters
        ----------
        bits : tuple of str
            Their names without what they all begin with.
        """
        text = " | ".join(self.BIT + bit for bit in bits)
        return f"({text})" if len(bits) > 1 else text

    def format_status(self) -> str:
        """Spell the word that gathers the status bits."""
        return "status"
