"""Named constants that meet in one product: folded into one number, named after them."""

from __future__ import annotations

import math
import zlib
from collections import Counter
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple

from codegen.ir.graph import SIGNIFICANT, Graph, Node

#: A number no larger than LARGEST that is a multiple of 1 / ROUND could be any number: it gets no name.
ROUND, LARGEST = 64.0, 16.0

#: The largest denominator of a number in a name, and how many folds are followed back.
DENOMINATOR, DEEPEST = 4096, 40

#: How words are cut, one after another, in a name that is too long for C89.
SHORTER = (
    ("SALIENCY", "SAL"),
    ("POLE_PAIRS", "PP"),
    ("TORQUE", "TQ"),
    ("GAIN", "G"),
    ("DECAY", "DEC"),
    ("OMEGA", "OM"),
    ("WEIGHT", "WT"),
    ("HALF", "H"),
    ("INERTIA", "J"),
    ("_MINUS_", "_M_"),
)


class Folded(NamedTuple):
    """Constants of one product as one number."""

    value: float
    name: str
    formula: str


def folded(graph: Graph, constants: list[int]) -> Folded:
    """Constants of a graph as one number, named after them.

    Parameters
    ----------
    graph : Graph
        Keeps in ``folds`` what the number was made of.
    constants : list of int
        Nodes that are constants, one or more.
    """
    constants = sorted(constants, key=lambda k: (graph[k].name, graph[k].value))
    value = math.prod(graph[index].value for index in constants)
    graph.folds.setdefault(value, ("mul", tuple(graph[index] for index in constants)))
    if len(constants) == 1:
        return Folded(value, graph[constants[0]].name, graph[constants[0]].formula)
    names, plain = Counter[str](), 1.0
    for index in constants:
        some, number = taken_apart(graph[index])
        names, plain = names + some, plain * number
    names = Counter(dict(sorted(names.items())))
    return Folded(value, product_name(names, plain), _formula(names, plain))


def product_name(names: Counter[str], plain: float) -> str:
    """``A_B`` for A times B, ``A_SQ`` for A times A, ``A_X4`` for 4 A, ``A_BY4`` for A / 4; else nothing.

    Parameters
    ----------
    names : Counter of str
        Named constants, and how often each is a factor.
    plain : float
        The number beside them.

    Returns
    -------
    str
        Empty where a name is held more than twice, the number is neither whole nor one over a whole number, or the name
        is longer than :data:`codegen.ir.graph.SIGNIFICANT`.
    """
    by = 0.0 < plain < 1.0
    number = 1.0 / plain if by else plain
    if not names or number != int(number) or any(count > 2 for count in names.values()):
        return ""
    parts = [name + ("_SQ" if count == 2 else "") for name, count in names.items()]
    name = "_".join(parts + ([f"{'BY' if by else 'X'}{int(number)}"] if number != 1.0 else []))
    return name if len(name) <= SIGNIFICANT else ""


def taken_apart(node: Node) -> tuple[Counter[str], float]:
    """The names a constant was multiplied together from, and the number beside them.

    Parameters
    ----------
    node : Node
        A constant.
    """
    if not node.name:
        return Counter(), node.value
    tokens = node.formula.split(" * ")
    names = Counter(token for token in tokens if token.isidentifier())
    plain = math.prod(float(token) for token in tokens if _is_number(token))
    if all(token.isidentifier() or _is_number(token) for token in tokens) and product_name(names, plain) == node.name:
        return names, plain
    return Counter([node.name]), 1.0


def is_round(value: float) -> bool:
    """Whether a number is one that formulas hold by themselves: small, and a whole number of 1 / ROUND.

    Parameters
    ----------
    value : float
    """
    return abs(value) <= LARGEST and (ROUND * value).is_integer()


@dataclass(frozen=True)
class Monomial:
    """A number times powers of named constants and sums; ``formulas`` holds those of the sums, by name."""

    number: float
    powers: dict[str, int]
    formulas: dict[str, str]

    def times(self, other: Monomial, power: int = 1) -> Monomial:
        """The product with another one, or with its reciprocal.

        Parameters
        ----------
        other : Monomial
        power : {1, -1}, optional
            -1 for the reciprocal.
        """
        powers = Counter(self.powers)
        for name, count in other.powers.items():
            powers[name] += power * count
        kept = {name: powers[name] for name in sorted(powers) if powers[name]}
        return Monomial(self.number * other.number**power, kept, self.formulas | other.formulas)

    @property
    def fraction(self) -> Fraction:
        """The number as a fraction of small integers; 0 where it is none."""
        if not math.isfinite(self.number):  # a sum of which a part has no name
            return Fraction(0)
        found = Fraction(self.number).limit_denominator(DENOMINATOR)
        return found if math.isclose(found, self.number, rel_tol=1e-12) else Fraction(0)

    @property
    def name(self) -> str:
        """``A_SQ_X5_PER_B`` for 5 A^2 / B, its words cut short until a compiler tells it apart; else nothing."""
        number = self.fraction
        if not number:
            return ""
        if not self.powers:
            return "ONE" if number == 1 else ""
        words = [_power(name, count) for name, count in self.powers.items() if count > 0] or ["ONE"]
        words += [f"X{abs(number.numerator)}"] if abs(number.numerator) != 1 else []
        words += [f"BY{number.denominator}"] if number.denominator != 1 else []
        words += [f"PER_{_power(name, -count)}" for name, count in self.powers.items() if count < 0]
        return _cut("_".join((["MINUS"] if number < 0 else []) + words))

    @property
    def formula(self) -> str:
        """In the words of the model's constants; without brackets where it is one sum alone."""
        number, names = self.fraction, list(Counter(self.powers).elements())
        below = [name for name, count in self.powers.items() for _ in range(-count)]
        if number == 1 and len(names) == 1 and not below:
            return self.formulas.get(names[0], names[0])

        def spelt(name: str) -> str:
            return f"({self.formulas[name]})" if name in self.formulas else name

        exact = (10**6 * number).denominator == 1
        scale = f"{float(number):g}" if exact else f"{number.numerator} / {number.denominator}"
        above = ([] if number == 1 and names else [scale]) + [spelt(name) for name in names]
        return " / ".join([" * ".join(above), *map(spelt, below)])


def with_names(graph: Graph) -> Graph:
    """The graph, its numbers that were folded from named constants named after them; no value changes.

    Parameters
    ----------
    graph : Graph
        Its ``folds`` and ``told`` say what numbers were made of.
    """
    nameless = dict.fromkeys(n.value for n in graph.nodes if n.op == "const" and not n.name and not is_round(n.value))
    found = {value: _origin(Node("const", value=value), graph) for value in nameless}
    named = {value: (made.name, made.formula) for value, made in found.items() if made.powers and made.name}
    return graph.named(named | {value: told for value, told in graph.told.items() if value in nameless})


def _origin(node: Node, graph: Graph, depth: int = 0) -> Monomial:
    """A constant as it was made of named ones; a number alone if it was not."""
    if node.name:
        names, plain = taken_apart(node)
        return Monomial(plain, dict(sorted(names.items())), {})
    plain_number = Monomial(node.value, {}, {})
    if is_round(node.value) or depth > DEEPEST:
        return plain_number
    if node.value in graph.told:
        return Monomial(1.0, {graph.told[node.value][0]: 1}, {})
    if node.value not in graph.folds:
        if -node.value not in graph.folds:
            return plain_number
        opposite = _origin(Node("const", value=-node.value), graph, depth + 1)
        return Monomial(-opposite.number, opposite.powers, opposite.formulas)
    op, operands = graph.folds[node.value]
    parts = [_origin(operand, graph, depth + 1) for operand in operands]
    if op in {"mul", "div"}:
        whole = parts[0]
        for part in parts[1:]:
            whole = whole.times(part, -1 if op == "div" else 1)
        return whole
    if op == "neg":
        return Monomial(-parts[0].number, parts[0].powers, parts[0].formulas)
    return _summed(op, parts) if op in {"add", "sub"} else plain_number


def _summed(op: str, parts: list[Monomial]) -> Monomial:
    """``A_PLUS_B`` or ``A_MINUS_B``; a number alone if one of them has no name."""
    a, b = parts
    sign = -1.0 if op == "sub" else 1.0
    if not a.powers and not b.powers:
        return Monomial(a.number + sign * b.number, {}, {})
    if a.powers == b.powers:
        return Monomial(a.number + sign * b.number, a.powers, a.formulas | b.formulas)
    word, mark = ("MINUS", "-") if op == "sub" else ("PLUS", "+")
    if not a.name or not b.name:
        return Monomial(math.nan, {}, {})
    name = _cut(f"{a.name}_{word}_{b.name}")
    return Monomial(1.0, {name: 1}, {name: f"{a.formula if a.powers else '1'} {mark} {b.formula if b.powers else '1'}"})


def _cut(name: str) -> str:
    """A name that C89 tells apart: words of SHORTER first, then the longest ones are cut, and a mark keeps it apart."""
    whole = name
    for word, short in SHORTER:
        if len(name) > SIGNIFICANT:
            name = name.replace(word, short)
    if len(name) <= SIGNIFICANT:
        return name
    words = name.split("_")
    mark = f"_{zlib.crc32(whole.encode()) & 0xFFF:03X}"
    while len("_".join(words)) + len(mark) > SIGNIFICANT:
        longest = max(range(len(words)), key=lambda k: (len(words[k]), k))
        words[longest] = words[longest][:-1]
    return "_".join(filter(None, words)) + mark


def _power(name: str, count: int) -> str:
    return name + {1: "", 2: "_SQ"}.get(count, f"_P{count}")


def _is_number(token: str) -> bool:
    return token.replace(".", "", 1).isdigit()


def _formula(names: Counter[str], plain: float) -> str:
    return " * ".join([*([repr(plain).removesuffix(".0")] if plain != 1.0 else []), *names.elements()])
