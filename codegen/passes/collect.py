"""a x + b x = (a + b) x: sums collected in the factor that is known last.

Along the columns of L the same combination of constants and base values, a + b, meets another x each time;
collected, it is computed once for all columns. Products of sums that serve nothing else are multiplied out first.
"""

from __future__ import annotations

from collections import Counter

from codegen.ir.graph import Graph

Term = tuple[bool, list[int]]
"""A term of a sum: negative?, and its factors as nodes of the old graph."""

SUMS = frozenset({"add", "sub"})


def collect(graph: Graph, roots: list[int]) -> tuple[Graph, dict[int, int]]:
    """Multiply out, then collect, every sum.

    Parameters
    ----------
    graph : Graph
    roots : list of int
        Nodes that must survive as values.

    Returns
    -------
    tuple of Graph and dict of int to int
        The new graph, and its nodes by the old ones'.

    >>> g = Graph()
    >>> a, b, x, y = (g.input(name) for name in "abxy")
    >>> sums = [g.op("add", g.op("mul", a, x), g.op("mul", b, x)), g.op("add", g.op("mul", a, y), g.op("mul", b, y))]
    >>> new, moved = collect(g, sums)
    >>> [new[index].op for index in new.reachable([moved[each] for each in sums])]
    ['input', 'input', 'add', 'input', 'mul', 'input', 'mul']
    """
    return _Collector(graph, roots).run()


class _Collector:
    def __init__(self, graph: Graph, roots: list[int]) -> None:
        self.graph = graph
        self.order = graph.reachable(roots)
        self.rank = {index: k for k, index in enumerate(self.order)}
        uses = Counter(arg for index in self.order for arg in graph.nodes[index].args)
        self.once = {index for index in self.order if uses[index] == 1} - set(roots)
        self.opened: dict[int, list[Term]] = {}
        self.new = Graph()
        self.moved: dict[int, int] = {}

    def run(self) -> tuple[Graph, dict[int, int]]:
        for index in self.order:
            node = self.graph.nodes[index]
            if node.op in SUMS:
                self.moved[index] = self._sum(self._terms(index))
            else:
                self.moved[index] = self.new.adopt(node, [self.moved[arg] for arg in node.args])
        return self.new, self.moved

    def _terms(self, index: int) -> list[Term]:
        """A sum as terms; inner sums and products of sums opened where nothing else uses them."""
        node = self.graph.nodes[index]
        if node.op not in SUMS:
            return self._product(index)
        left, right = (self._open(arg) for arg in node.args)
        return left + [(negative != (node.op == "sub"), factors) for negative, factors in right]

    def _open(self, index: int) -> list[Term]:
        if index not in self.opened:
            self.opened[index] = self._terms(index) if index in self.once else [(False, [index])]
        return self.opened[index]

    def _product(self, index: int) -> list[Term]:
        node = self.graph.nodes[index]
        if node.op != "mul":
            return [(False, [index])]
        left, right = (self._open(arg) for arg in node.args)
        if len(left) > 1 and len(right) > 1:  # both sums: nothing is gained by multiplying them out
            return [(False, list(node.args))]
        return [(a != b, [*p, *q]) for a, p in left for b, q in right]

    def _sum(self, terms: list[Term]) -> int:
        """The terms added up, collected in one factor after the other."""
        terms = list(terms)
        while shared := self._shared(terms):
            factor = max(shared, key=lambda f: (self.graph[f].op != "const", self.rank[f]))
            held = [k for k, (_, factors) in enumerate(terms) if factor in factors]
            inner = []
            for k in held:
                negative, factors = terms[k]
                rest = list(factors)
                rest.remove(factor)
                inner.append((negative, rest))
            others = {other for k, (_, factors) in enumerate(terms) if k not in held for other in factors}
            terms[held[0]] = self._wrap(factor, inner, others)
            for k in reversed(held[1:]):
                del terms[k]
        terms.sort(key=lambda term: self._is_input(term[1]))
        return self._added([(negative, self._multiplied(factors)) for negative, factors in terms])

    @staticmethod
    def _shared(terms: list[Term]) -> set[int]:
        """Nodes of the old graph that are factors of several terms."""
        seen, shared = set[int](), set[int]()
        for _, factors in terms:
            shared |= seen.intersection(factors)
            seen.update(factors)
        return {factor for factor in shared if factor >= 0}

    def _is_const(self, factor: int) -> bool:
        return factor >= 0 and self.graph[factor].op == "const"

    def _is_input(self, factors: list[int]) -> bool:
        """A bare input is added last: what corrects a state is small beside it, and is summed up first."""
        return len(factors) == 1 and factors[0] >= 0 and self.graph[factors[0]].op == "input"

    def _wrap(self, factor: int, inner: list[Term], others: set[int]) -> Term:
        """factor * (sum of inner), as one term; its sign is the first inner term's.

        What all inner terms hold besides stays a factor of the term where it is among those of the sum's ``others``:
        it is collected with them.
        """
        flip = inner[0][0]
        common = Counter(other for other in inner[0][1] if other in others)
        for _, factors in inner[1:]:
            common &= Counter(factors)
        if any(self._is_const(k) and k not in common for k in (factor, *inner[0][1])):  # numbers that meet are one
            common = Counter({k: times for k, times in common.items() if not self._is_const(k)})
        rests = [(negative != flip, list((Counter(factors) - common).elements())) for negative, factors in inner]
        product = self.new.op("mul", self._sum(rests), self.moved[factor])
        return flip, [*common.elements(), self._collected(product)]

    def _collected(self, node: int) -> int:
        """A node of the new graph under a name of its own among the old ones."""
        alias = -1 - node
        self.moved[alias] = node
        self.rank[alias] = len(self.rank)
        return alias

    def _multiplied(self, factors: list[int]) -> int:
        if not factors:
            return self.new.const(1.0)
        value = self.moved[factors[0]]
        for factor in factors[1:]:
            value = self.new.op("mul", value, self.moved[factor])
        return value

    def _added(self, terms: list[tuple[bool, int]]) -> int:
        """Left to right, beginning with a positive term if there is one."""
        first = next((k for k, (negative, _) in enumerate(terms) if not negative), None)
        if first is None:
            return self.new.op("neg", self._added([(False, value) for _, value in terms]))
        ordered = [terms[first], *terms[:first], *terms[first + 1 :]]
        value = ordered[0][1]
        for negative, other in ordered[1:]:
            value = self.new.op("sub" if negative else "add", value, other)
        return value
