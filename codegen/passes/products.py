"""Products taken apart and put together again so that what they share is computed once.

``a (b c)`` and ``b (a d)`` share ``a b`` although no node does. Every product is flattened into its factors;
then the pair of factors that most products hold becomes a factor of its own, again and again, until no pair
is held twice (greedy two-factor sharing). Constants are factors like the others, but those that meet in one
product are folded into one number first.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection
from heapq import heappop, heappush
from itertools import combinations

from codegen.ir.constants import Folded, folded, product_name, taken_apart
from codegen.ir.graph import Graph


def share_products(
    graph: Graph, roots: list[int], whole: bool = True, squares: bool = False
) -> tuple[Graph, dict[int, int]]:
    """Regroup products; sums and functions stay as they are.

    Parameters
    ----------
    graph : Graph
    roots : list of int
        Nodes that must survive as values.
    whole : bool, optional
        Inner products are taken apart even where several products share them already; else those stay.
    squares : bool, optional
        Beside a square, that of a known constant counts as the constant twice: K^2 x^2 = (K x) (K x).

    Returns
    -------
    tuple of Graph and dict of int to int
        The new graph, and its nodes by the old ones'.

    >>> g = Graph()
    >>> a, b, c, d = (g.input(name) for name in "abcd")
    >>> one, two = g.op("mul", a, g.op("mul", b, c)), g.op("mul", b, g.op("mul", a, d))
    >>> new, moved = share_products(g, [g.op("add", one, two)])
    >>> sum(node.op == "mul" for node in new.nodes)
    3
    """
    products = _Products(graph, roots, whole, squares)
    products.share()
    return products.rebuild()


#: A node of the old graph or, by numbers from its size on, what is made beside them: constants folded, pairs shared.
Factor = int
Pair = tuple[Factor, Factor]
#: The factors of a product, and how often it holds each.
Held = dict[Factor, int]


class _Products:
    """The products of a graph that something other than a product uses, or that must survive, as their factors."""

    def __init__(self, graph: Graph, roots: list[int], whole: bool, squares: bool) -> None:
        self.graph, self.nodes, self.order = graph, graph.nodes, graph.reachable(roots)
        #: When a factor is known: nodes in order, pairs with their later half. Folded constants are not told: at once.
        self.rank: dict[Factor, float] = {index: float(rank) for rank, index in enumerate(self.order)}
        self.numbers: dict[Folded, Factor] = {}
        self.pairs: dict[Factor, Pair] = {}
        muls = [index for index in self.order if self.nodes[index].op == "mul"]
        uses = Counter(arg for index in self.order for arg in self.nodes[index].args)
        self.kept = set() if whole else {index for index in muls if uses[index] > 1}
        others = (self.nodes[index] for index in self.order if self.nodes[index].op != "mul")
        tops = {arg for node in others for arg in node.args}.union(roots, self.kept)
        constants = (index for index in self.order if self.nodes[index].op == "const" and self.nodes[index].name)
        self.roots = {self.nodes[index].name: index for index in constants} if squares else {}
        self.inner = set(muls) - tops
        self.factors = {index: self._folded(self._factors(index)) for index in muls if index in tops}

    def _factors(self, top: int) -> Held:
        """Factors of a product, inner products taken apart unless they are to be kept."""
        nodes, found = self.nodes, Held()
        stack = list(nodes[top].args)
        while stack:
            index = stack.pop()
            if nodes[index].op == "mul" and index not in self.kept:
                stack += nodes[index].args
            else:
                found[index] = found.get(index, 0) + 1
        return found

    def _folded(self, found: Held) -> Held:
        """All constants of a product as one; beside a square, the squares of ``roots`` are taken apart."""
        constants = [index for index in found if self.nodes[index].op == "const" for _ in range(found[index])]
        if not constants:
            return found
        if len(constants) > 1:
            found = {index: times for index, times in found.items() if index not in constants}
            number = folded(self.graph, constants)
            return found if number.value == 1.0 else found | {self._number(number): 1}
        return self._rooted(found, constants[0]) if self.roots and max(found.values()) > 1 else found

    def _rooted(self, found: Held, index: int) -> Held:
        """A constant as the root whose square it holds, twice, and the number that is left; else as it is."""
        names, plain = taken_apart(self.nodes[index])
        root = self.roots.get(product_name(Counter(dict.fromkeys(names, 1)), 1.0))
        if root is None or set(names.values()) != {2}:
            return found
        rest = {other: times for other, times in found.items() if other != index}
        return rest | {root: 2} | ({self._number(Folded(plain, "", "")): 1} if plain != 1.0 else {})

    def _number(self, number: Folded) -> Factor:
        factor = self.numbers.setdefault(number, len(self.nodes) + len(self.numbers))
        self.rank[factor] = -1.0
        return factor

    def share(self) -> None:
        """Make the most frequent pair a factor of its own, again and again until none is frequent.

        Among equally frequent pairs the one known first is taken, so that what does not change is computed first.
        """
        rank, total = self.rank, dict[Pair, int]()
        holders = defaultdict[Pair, dict[int, int]](dict)  # how often a product holds a pair, side by side
        queue: list[tuple[int, float, float, Pair]] = []  # the best first; what holds less often by now comes again

        def counted(top: int, among: Collection[Factor]) -> None:
            for pair, times in self._pairs(self.factors[top], among):
                total[pair] = total.get(pair, 0) + times
                holders[pair][top] = times
                if total[pair] > 1:
                    heappush(queue, (-total[pair], rank[pair[1]], rank[pair[0]], pair))

        for top, held in self.factors.items():
            counted(top, held)
        while queue:
            times, later, earlier, best = heappop(queue)
            if -times != total[best]:
                if -times > total[best] > 1:
                    heappush(queue, (-total[best], later, earlier, best))
                continue
            made = len(self.nodes) + len(self.numbers) + len(self.pairs)
            self.pairs[made] = best
            rank[made] = max(rank[best[0]], rank[best[1]]) + 1e-3 * len(self.pairs)
            changed = {*best, made}
            for top, times in sorted(holders[best].items()):
                held = self.factors[top]
                for pair, before in self._pairs(held, changed):
                    total[pair] -= before
                    del holders[pair][top]
                held[made] = times
                for factor in best:
                    held[factor] -= times
                for factor in set(best):
                    if not held[factor]:
                        del held[factor]
                counted(top, changed)

    def _pairs(self, held: Held, among: Collection[Factor]) -> list[tuple[Pair, int]]:
        """Every pair that a product holds and of which one factor is ``among`` some, the earlier first; how often."""
        distinct = sorted(held, key=self.rank.__getitem__)
        squares = [((a, a), times // 2) for a, times in held.items() if times > 1 and a in among]
        pairs = [pair for pair in combinations(distinct, 2) if pair[0] in among or pair[1] in among]
        return squares + [(pair, min(held[pair[0]], held[pair[1]])) for pair in pairs]

    def rebuild(self) -> tuple[Graph, dict[int, int]]:
        """The new graph, and where its nodes are by the old ones' and by factors."""
        new, moved = Graph(), dict[Factor, int]()
        numbers = {factor: number for number, factor in self.numbers.items()}

        def place(factor: Factor) -> int:
            if factor not in moved:
                if factor in self.pairs:
                    a, b = map(place, self.pairs[factor])
                    moved[factor] = new.op("mul", a, b)
                elif factor in numbers:
                    moved[factor] = new.const(*numbers[factor])
                else:  # a named constant, the root of a square
                    moved[factor] = new.adopt(self.nodes[factor], [])
            return moved[factor]

        for index in self.order:
            if index in self.factors:
                held = self.factors[index]
                value, *others = (place(f) for f in sorted(held, key=self.rank.__getitem__) for _ in range(held[f]))
                for other in others:
                    value = new.op("mul", value, other)
                moved[index] = value
            elif index not in self.inner:
                moved[index] = new.adopt(self.nodes[index], [moved[arg] for arg in self.nodes[index].args])
        return new, moved
