"""Where a supervisor's arrays live, and which of them what it does reads and sets."""

from __future__ import annotations

from codegen.ir.covariance import CovarianceLayout
from model.filters.conditions import Entry
from model.filters.program import Call, Count, If, Node, Restart, Set, entries_of, nodes
from model.supervisor.words import CopyFilter, ExchangeFilters, Supervisor

#: What an action does, in order.
Body = tuple[Node | CopyFilter | ExchangeFilters, ...]

#: The field of a filter that is one number.
SCORE = "nis"


class Places:
    """Where a machine's arrays live: in its own struct, in the filter's, or on the stack."""

    def __init__(self, machine: Supervisor, layout: CovarianceLayout) -> None:
        self.own = {field.name: field for field in machine.fields}
        self.layout = layout
        self.filter = {"x", "x_0", "P_0", SCORE, layout.field}

    def entry(self, entry: Entry) -> Entry:
        """An entry by the array that holds it: a variance is one of the covariance's words.

        Parameters
        ----------
        entry : Entry
        """
        if entry.name != "variance":
            return entry
        assert entry.place is not None
        return Entry(self.layout.field, self.layout.variances[entry.place])

    def read(self, body: Body) -> list[str]:
        """Names of all arrays and fields that a body reads or sets.

        Parameters
        ----------
        body : tuple of Node
        """
        found: list[str] = []
        for node in nodes(body):  # type: ignore[arg-type]
            if isinstance(node, CopyFilter | ExchangeFilters):
                found += ["x", "rival"]
                continue
            if isinstance(node, Call):
                found += [port.name for port in (*node.block.inputs, *node.block.outputs)]
            elif isinstance(node, Count):
                found.append(node.counter)
            elif isinstance(node, If):
                found += [self.entry(entry).name for entry in entries_of(node.condition)]
            elif isinstance(node, Restart):
                found += ["x", self.layout.field]
            else:
                found += [self.entry(entry).name for entry in entries_of(node)]
        return list(dict.fromkeys(found))

    def changed(self, body: Body) -> list[str]:
        """Names of the arrays and fields that a body sets.

        Parameters
        ----------
        body : tuple of Node
        """
        found: list[str] = []
        for node in nodes(body):  # type: ignore[arg-type]
            if isinstance(node, ExchangeFilters):
                found += ["x"]
            elif isinstance(node, Call):
                found += [port.name for port in node.block.outputs]
            elif isinstance(node, Count):
                found.append(node.counter)
            elif isinstance(node, Set):
                found.append(self.entry(node.target).name)
            elif isinstance(node, Restart):
                found += ["x", self.layout.field]
        return list(dict.fromkeys(found))

    def local(self, body: Body) -> dict[str, int]:
        """Arrays on the stack that a body makes, and their lengths.

        Parameters
        ----------
        body : tuple of Node
        """
        outputs = (port for node in nodes(body) if isinstance(node, Call) for port in node.block.outputs)  # type: ignore[arg-type]
        return {port.name: len(port.entries) for port in outputs if port.name not in self.own}
