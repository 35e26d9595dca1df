"""From a block to an ordered, named listing: what the printers print, still without a language.

An operation gets a local of its own if a stage names it or if it is used more than once; everything else
is written where it is used. Sections follow the paper's equation numbers.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from codegen.ir.constants import with_names
from codegen.ir.expr import GraphBlock
from codegen.ir.graph import SIGNIFICANT, Graph, read_tape
from model.quantities import Block, Constant, Stage


@dataclass(frozen=True)
class PairFunction:
    """A helper that returns two values at once: its name in print, the operations it serves, what they are called."""

    name: str
    operations: tuple[str, str]
    members: tuple[str, str]
    argument: str


SIN_COS = PairFunction("sin_cos", ("sin", "cos"), ("sine", "cosine"), "angle")
#: Ends the name of an angle that was wrapped for its sine and cosine.
WRAPPED = "_wrapped"
SMALL_ANGLE = PairFunction("small_angle", ("sinc", "cosm1"), ("sinc", "cosm1"), "z")
PAIRS = {op: function for function in (SIN_COS, SMALL_ANGLE) for op in function.operations}


@dataclass(frozen=True)
class Statement:
    """``name = expression of node``; for a pair the names of its halves, ``node`` being the argument.

    ``spread``: of small angles, the n in z = d^2 / n.
    """

    node: int
    name: str
    pair: tuple[str, str] | None = None
    function: PairFunction | None = None
    spread: float = 1.0


@dataclass
class Section:
    """Statements that serve one equation."""

    equation: str
    title: str
    statements: list[Statement] = field(default_factory=list)

    @property
    def heading(self) -> str:
        """Equation number and title, as far as there are any."""
        return ": ".join(part for part in (f"eq. {self.equation}" if self.equation else "", self.title) if part)


@dataclass
class Listing:
    """A block, ready to print."""

    block: Block
    graph: Graph
    names: dict[int, str]
    sections: list[Section]
    outputs: dict[str, list[int]]
    stages: dict[str, list[int]]
    live: frozenset[int]

    @property
    def used_inputs(self) -> dict[str, list[tuple[int, str]]]:
        """For each input port, the (position, name) of the scalars the block really reads."""
        live_names = {self.graph[node].name for node in self.live if self.graph[node].op == "input"}
        return {
            port.name: [(k, name) for k, name in enumerate(port.names) if name in live_names]
            for port in self.block.inputs
        }

    @property
    def spreads(self) -> set[float]:
        """The n of the small angles z = d^2 / n that are computed here."""
        return {s.spread for section in self.sections for s in section.statements if s.function is SMALL_ANGLE}

    def operations(self) -> Counter[str]:
        """Operations of one run: add (with sub and neg), mul, div, sqrt, sincos, wrap."""
        count: Counter[str] = Counter()
        pairs = set()
        for index in self.live:
            node = self.graph[index]
            if node.op in PAIRS:
                pairs.add((PAIRS[node.op].name, node.args[0]))
            elif node.op in {"add", "sub", "neg"}:
                count["add"] += 1
            elif node.op not in {"input", "const"}:
                count[node.op] += 1
        count["sincos"] += sum(name == SIN_COS.name for name, _ in pairs)
        count["small_angle"] += sum(name == SMALL_ANGLE.name for name, _ in pairs)
        return count


#: The port that is a filter's state between steps, and its entry that every step leaves within a turn.
STATE, ANGLE = "x", "theta"


def lay_out(block: Block, constants: Sequence[Constant], any_angle: bool = False) -> Listing:
    """Read a block's tape (or take its graph as it stands), name its operations and order them.

    Parameters
    ----------
    block : Block
    constants : sequence of Constant
        Those of the tape; one without a symbol is known by its value.
    any_angle : bool, optional
        Its sines and cosines take any angle, as those of float64 do. Else they take one within a turn, and an angle
        that is not the state's is wrapped before.

    Returns
    -------
    Listing
    """
    graph, outputs, stages = _taken(block) if isinstance(block, GraphBlock) else _to_graph(block, constants)
    hints = {entry.node: name for name, entry in reversed(block.hints)} if isinstance(block, GraphBlock) else {}
    if not any_angle:
        graph, moved = _within_a_turn(graph, block)
        outputs, stages = ({k: [moved[n] for n in nodes] for k, nodes in of.items()} for of in (outputs, stages))
        hints = {moved[node]: name for node, name in hints.items()}
    roots = [node for nodes in outputs.values() for node in nodes]
    live = frozenset(graph.reachable(roots))
    names = _name(block, graph, stages, live, hints)
    sections = _order(block, graph, names, stages, live, roots)
    return Listing(block, graph, names, sections, outputs, stages, live)


def _to_graph(block: Block, constants: Sequence[Constant]) -> tuple[Graph, dict[str, list[int]], dict[str, list[int]]]:
    graph = Graph()
    ports = [ca.vertcat(*port.entries) for port in block.inputs]
    results = [ca.SX(ca.vertcat(*item)) for item in _results(block)]
    symbolic = [constant for constant in constants if constant.symbol is not None]
    symbols = [ca.vertcat(*(constant.symbol for constant in symbolic))] if symbolic else []
    function = ca.Function(block.name, [*ports, *symbols], [ca.densify(result) for result in results])
    inputs = [[graph.input(name) for name in port.names] for port in block.inputs]
    if symbolic:
        inputs.append([graph.const(constant.value, constant.name, constant.formula) for constant in symbolic])
    nodes = read_tape(graph, function, inputs)
    graph = with_names(graph.named({c.value: (c.name, c.formula) for c in constants if c.symbol is None}))
    stage_nodes = dict(zip((stage.name for stage in block.stages), nodes, strict=False))
    assert len(stage_nodes) == len(block.stages), "stage names must differ within a block"
    output_nodes = dict(zip((port.name for port in block.outputs), nodes[len(block.stages) :], strict=True))
    return graph, output_nodes, stage_nodes


def _taken(block: GraphBlock) -> tuple[Graph, dict[str, list[int]], dict[str, list[int]]]:
    outputs = {port.name: [entry.node for entry in port.entries] for port in block.outputs}
    stages = {stage.name: [entry.node for entry in stage.entries] for stage in block.stages}
    return block.graph, outputs, stages


def _results(block: Block) -> list[tuple[Any, ...]]:
    return [stage.entries for stage in block.stages] + [port.entries for port in block.outputs]


def _within_a_turn(graph: Graph, block: Block) -> tuple[Graph, list[int]]:
    """Wrap what sine and cosine are taken of, unless that is the state's angle; the graph, and where nodes went."""
    known = {ANGLE} & {name for port in block.inputs if port.name == STATE for name in port.names}
    new, moved = Graph(), list[int]()
    new.folds, new.told = graph.folds, graph.told
    for node in graph.nodes:
        args = [moved[arg] for arg in node.args]
        if node.op in SIN_COS.operations and new[args[0]].op != "wrap" and new[args[0]].name not in known:
            args = [new.op("wrap", args[0])]
        moved.append(new.adopt(node, args))
    return new, moved


def _name(
    block: Block, graph: Graph, stages: dict[str, list[int]], live: frozenset[int], hints: dict[int, str]
) -> dict[int, str]:
    """Every node that gets a name: inputs, named constants, stage entries, sines and cosines, shared work."""
    names = {k: node.name for k, node in enumerate(graph.nodes) if node.name}
    taken = set(names.values())
    for stage in block.stages:
        for entry, name in zip(stages[stage.name], stage.names, strict=True):
            if entry in live and entry not in names and graph[entry].op not in {"const", "sin", "cos"}:
                names[entry] = _fresh(name, taken)
    uses = Counter(arg for index in live for arg in graph[index].args)
    first_user: dict[int, int] = {}
    for index in sorted(live):
        for arg in graph[index].args:
            first_user.setdefault(arg, index)
    turned = {graph[index].args[0] for index in live if graph[index].op in SIN_COS.operations}
    for index in sorted(live):
        node = graph[index]
        if node.op == "wrap" and index in turned and node.args[0] in names:
            names.setdefault(index, _fresh(f"{names[node.args[0]]}{WRAPPED}", taken))
        elif node.op in PAIRS:
            if node.args[0] not in names:
                names[node.args[0]] = _fresh(PAIRS[node.op].argument, taken)
            if index not in names:
                names[index] = _fresh(f"{node.op}_{names[node.args[0]].removesuffix(WRAPPED)}", taken)
        elif index not in names and uses[index] > 1 and node.op not in {"const", "neg"}:
            names[index] = _fresh(hints.get(index) or _describe(graph, index, names, first_user), taken)
    return names


_WORDS = {"add": "plus", "sub": "minus", "mul": "times", "div": "per"}
_SHORT = {"mul": "x"}
_SHORTEST = {"mul": "x", "add": "and", "sub": "less"}  # and no constant by its name
_NUMBERS = {1.0: "one", 2.0: "two", 0.5: "half", 0.25: "quarter"}


def _describe(graph: Graph, index: int, names: dict[int, str], first_user: dict[int, int]) -> str:
    """A name for work that is shared but that no stage names: what it is made of, else what it is part of."""
    for words in (_WORDS, _SHORT, _SHORTEST):
        text = _made_of(graph, index, names, words)
        if text and len(text) <= SIGNIFICANT:
            return text
    user = first_user.get(index)
    while user is not None and user not in names:
        user = first_user.get(user)
    return f"part_of_{names[user]}" if user is not None else "part_of_the_result"


def _made_of(graph: Graph, index: int, names: dict[int, str], words: dict[str, str]) -> str:
    """An operation in words; empty if something in it has no name that tells what it is."""
    node = graph[index]
    parts = [_word(graph, arg, names, words) for arg in node.args]
    if node.op == "mul" and (scaled := _scaled(graph, node.args, parts)):
        return scaled
    if not all(parts):
        return ""
    if node.op == "mul" and words is _SHORTEST and (scale := [g for g in node.args if graph[g].op == "const"]):
        other = parts[1 - node.args.index(scale[0])]
        number = _NUMBERS.get(graph[scale[0]].value)
        return f"{number}_{other}" if number else f"{other}_scaled"
    if node.op == "mul" and parts[0] == parts[1]:
        return f"{parts[0]}_sq"
    word = f"_{words.get(node.op, node.op)}_"
    if node.op == "mul" and any(part.startswith("one_per_") for part in parts):
        parts.sort(key=lambda part: part.startswith("one_per_"))
        word, parts[1] = "_per_", parts[1].removeprefix("one_per_")
    if node.op in {"add", "sub"} and all(arg in names for arg in node.args):
        return _joined(parts, word)
    return word.join(parts) if len(parts) > 1 else f"minus_{parts[0]}" if node.op == "neg" else ""


def _scaled(graph: Graph, args: tuple[int, ...], parts: list[str]) -> str:
    """``x_scaled`` for x by a number that has no name."""
    for part, other, by in (parts[0], parts[1], args[1]), (parts[1], parts[0], args[0]):
        if part and not other and graph[by].op == "const":
            return f"{part}_scaled"
    return ""


def _joined(parts: list[str], word: str) -> str:
    """Two names in one, what they begin and end with said once: ``odd_i_q_now_plus_next_0``."""
    a, b = (part.split("_") for part in parts)
    short = min(len(a), len(b)) - 1
    head = next((k for k in range(short) if a[k] != b[k]), short)
    tail = next((k for k in range(short - head) if a[-1 - k] != b[-1 - k]), short - head)
    middle = word.join("_".join(tokens[head : len(tokens) - tail]) for tokens in (a, b))
    return "_".join([*a[:head], middle, *a[len(a) - tail :]])


def _word(graph: Graph, index: int, names: dict[int, str], words: dict[str, str]) -> str:
    """An operand in a name; empty if nothing short can be said of it."""
    if graph[index].op == "const":
        return names.get(index, _NUMBERS.get(graph[index].value, "")).lower()
    if index in names or graph[index].op == "input":
        return "" if "part_of" in names[index] else names[index]
    return _made_of(graph, index, names, words) if graph[index].op in _WORDS or graph[index].op == "neg" else ""


def _fresh(name: str, taken: set[str]) -> str:
    """A name of its own, told from all others by what C89 compilers look at."""
    unique, k = name[:SIGNIFICANT], 2
    while unique in taken:
        suffix = f"_{k}"
        unique, k = name[: SIGNIFICANT - len(suffix)] + suffix, k + 1
    taken.add(unique)
    return unique


def _order(
    block: Block,
    graph: Graph,
    names: dict[int, str],
    stages: dict[str, list[int]],
    live: frozenset[int],
    roots: list[int],
) -> list[Section]:
    sections: list[Section] = []
    done: set[int] = set()
    last = block.last if isinstance(block, GraphBlock) else ()
    ordered = sorted(block.stages, key=lambda stage: last.index(stage.name) if stage.name in last else -1)
    for equation, title, nodes in [*_by_equation(ordered, stages), ("", "", roots)]:
        section = Section(equation, title)
        for index in graph.reachable(node for node in nodes if node in live):
            if index in done:
                continue
            done.add(index)
            node = graph[index]
            if node.op in PAIRS:
                done |= _pair(graph, names, PAIRS[node.op], node.args, section)
            elif index in names and node.op not in {"input", "const"}:
                section.statements.append(Statement(index, names[index]))
        if section.statements:
            sections.append(section)
        elif last and title:  # brought along by the section before
            before = sections.pop()
            title = f"{title}; eq. {before.equation}: {before.title}"
            sections.append(Section(equation, title, before.statements))
    return sections


def _pair(
    graph: Graph, names: dict[int, str], function: PairFunction, args: tuple[int, ...], section: Section
) -> set[int]:
    """Both values of a pair come from one call; returns the nodes it settles."""
    first, second = (graph.op(op, *args) for op in function.operations)
    argument, *rest = args
    label = f"{'sincos' if function is SIN_COS else 'turn'}_{names[argument].removesuffix(WRAPPED)}"
    halves = names.get(first, ""), names.get(second, "")
    spread = graph[rest[0]].value if rest else 1.0
    section.statements.append(Statement(argument, label, halves, function, spread))
    return {first, second}


def _by_equation(stages: list[Stage], nodes: dict[str, list[int]]) -> list[tuple[str, str, list[int]]]:
    """Neighbouring stages of one equation share a section; without equations each meaning begins one."""
    groups: list[tuple[str, list[str], list[int]]] = []
    for stage in stages:
        if not groups or groups[-1][0] != stage.equation or (stage.meaning and not stage.equation):
            groups.append((stage.equation, [], []))
        if stage.meaning:
            groups[-1][1].append(stage.meaning)
        groups[-1][2].extend(nodes[stage.name])
    return [(equation, "; ".join(titles), members) for equation, titles, members in groups]
