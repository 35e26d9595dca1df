"""Errors drawn from what judges and tells: comparisons, aggregates, truth, units, arithmetic of the modules around.

Every place of a sort is found in a module's syntax tree; some are drawn with a seed. What must notice a module's errors
stands in :data:`JUDGES`. Left alone are texts, how a figure looks (sizes, colours, places) and words of options.
"""

from __future__ import annotations

import ast
import random
from collections.abc import Callable, Iterator

from tests.mutants.mutant import ROOT, Mutant

SEED = 11
#: Sorts drawn in each module.
PLACES = 2

_TESTS = "tests/judges/test_"
FIRMWARE = f"{_TESTS}firmware_verdicts.py"
STATIC = f"{_TESTS}static_verdicts.py"
PROOF = f"{_TESTS}proof_verdicts.py {_TESTS}proof_tables.py"
DRIVE = f"{_TESTS}drive_figures.py {_TESTS}drive_commands.py {_TESTS}truth_figures.py"
UNITS, REPLAY, STUDY = (f"{_TESTS}{name}.py" for name in ("units", "replay_figures", "study_figures"))
FAULTS, ENDURANCE = (f"{_TESTS}{name}_verdicts.py" for name in ("fault", "endurance"))
NOTHING = f"{_TESTS}nothing_is_shown_by_nothing.py"
BOARD, PAGES, SIDE_BY_SIDE = (f"{_TESTS}{name}.py" for name in ("board_verdicts", "pages", "side_by_side"))

#: Module -> tests that must notice, and the functions to leave alone (they judge and tell nothing, or others try them).
JUDGES: dict[str, tuple[str, tuple[str, ...]]] = {
    "runtime/commands/verify.py": (PROOF, ()),
    "runtime/commands/firmware.py": (FIRMWARE, ()),
    "runtime/commands/run.py": (f"{PAGES} -k 'run_ends'", ()),
    "runtime/commands/generate.py": (f"{DRIVE} -k 'generate'", ()),
    "runtime/commands/simulate.py": (f"{DRIVE} -k 'simulate'", ()),
    "runtime/commands/compare.py": (f"{DRIVE} -k 'compare'", ()),
    "runtime/commands/replay.py": (f"{REPLAY} -k 'replay_ends'", ()),
    "runtime/commands/faults.py": (FAULTS, ()),
    "runtime/commands/fuzz.py": (ENDURANCE, ()),
    "runtime/commands/soak.py": (ENDURANCE, ()),
    "runtime/commands/pil.py": (BOARD, ()),
    "runtime/commands/record.py": (BOARD, ()),
    "runtime/commands/words.py": (PROOF, ("caution", "show_written", "show_remarks")),
    "runtime/system/verdicts.py": (NOTHING, ()),
    "runtime/proof/result.py": (PROOF, ()),
    "runtime/proof/drives.py": (PROOF, ("_verify_all",)),
    "runtime/proof/compare.py": (PROOF, ("entries_of",)),
    "runtime/proof/link_cd.py": (PROOF, ("link_cd",)),
    "runtime/proof/tables.py": (PROOF, ()),
    "runtime/proof/figures.py": (PROOF, ()),
    "runtime/firmware/gates.py": (FIRMWARE, ()),
    "runtime/firmware/tables.py": (FIRMWARE, ()),
    "runtime/firmware/link_ef.py": (FIRMWARE, ()),
    "runtime/firmware/emulator.py": (FIRMWARE, ("emulate",)),
    "runtime/firmware/static/compilers.py": (STATIC, ()),
    "runtime/firmware/static/misra.py": (STATIC, ("find",)),
    "runtime/drive/tables.py": (f"{DRIVE} -k 'table or claims or simulate'", ()),
    "runtime/drive/figures.py": (f"{DRIVE} -k 'figure or band'", ()),
    "runtime/drive/simulate.py": (f"{DRIVE} -k 'simulate'", ()),
    "runtime/recorded/truth.py": (f"{DRIVE} -k 'errors or load or lost or figures or lock or degrees'", ()),
    "runtime/recorded/clock.py": (f"{DRIVE} -k 'clock'", ()),
    "runtime/recorded/units.py": (UNITS, ()),
    "runtime/drive/scenario.py": (UNITS, ()),
    "runtime/replay/statistics.py": (
        f"{REPLAY} -k 'consistency or whitened or drawing or too_few or step_by_step'",
        (),
    ),
    "runtime/replay/tables.py": (f"{REPLAY} -k 'table'", ()),
    "runtime/replay/figures.py": (f"{REPLAY} -k 'drawing or panels'", ()),
    "runtime/study/analysis.py": (STUDY, ()),
    "runtime/study/tables.py": (f"{STUDY} -k 'table or words'", ()),
    "runtime/study/figures.py": (f"{STUDY} -k 'draw or map or tuning'", ("write_figures",)),
    "runtime/faults/survey.py": (FAULTS, ()),
    "runtime/faults/tables.py": (FAULTS, ()),
    "runtime/faults/figures.py": (FAULTS, ()),
    "runtime/endurance/tables.py": (ENDURANCE, ()),
    "runtime/endurance/figures.py": (ENDURANCE, ()),
    "runtime/board/tables.py": (BOARD, ()),
    "runtime/board/record.py": (BOARD, ("record", "ctrl_c")),
    "runtime/compare/facts.py": (f"{SIDE_BY_SIDE} -k 'costs or certificates'", ()),
    "runtime/compare/tables.py": (f"{SIDE_BY_SIDE} -k 'costs or certificates or accuracy or words'", ()),
    "runtime/compare/figures.py": (f"{SIDE_BY_SIDE} -k 'drawings'", ("_letter",)),
    "runtime/report/chapter.py": (f"{PAGES} -k 'run_ends or no_fault'", ()),
    "runtime/report/page.py": (f"{PAGES} -k 'page'", ()),
}

#: Arguments that style a figure or table; texts and numbers in these arguments are nobody's evidence.
_LOOKS = frozenset(
    {
        *("figsize", "lw", "ms", "ls", "fontsize", "alpha", "color", "colour", "edgecolors", "labelsize", "levels"),
        *("ncols", "loc", "bbox_to_anchor", "ha", "va", "rotation", "width", "widths", "height_ratios", "padding"),
        *("gridspec_kw", "wspace", "hspace", "left", "right", "top", "bottom", "justify", "style", "header_style"),
        *("no_wrap", "overflow", "title_justify", "caption_justify", "show_edge", "pad_edge", "pad", "box"),
        *("soft_wrap", "highlight", "markup", "indent"),
    }
)

#: A change of the source: from, to, and what then stands there.
Edit = tuple[int, int, str]
Finder = Callable[[ast.AST], Iterator[tuple[ast.AST, str]]]

_COMPARE: dict[type[ast.cmpop], str] = {
    ast.LtE: "<", ast.Lt: "<=", ast.GtE: ">", ast.Gt: ">=", ast.Eq: "!=", ast.NotEq: "==", ast.Is: "is not",
    ast.IsNot: "is", ast.In: "not in", ast.NotIn: "in",
}  # fmt: skip
_TURNED: dict[type[ast.cmpop], str] = {ast.LtE: ">", ast.Lt: ">=", ast.GtE: "<", ast.Gt: "<="}
_AGGREGATE = {
    "max": "min", "min": "max", "any": "all", "all": "any", "median": "mean", "mean": "median", "nanmedian": "nanmean",
    "bitwise_or": "bitwise_and", "cumsum": "cumprod",
}  # fmt: skip
_DROPPED = {"abs", "sqrt", "degrees", "log10", "bool"}
_ARITHMETIC: dict[type[ast.operator], str] = {
    ast.Mult: "/",
    ast.Div: "*",
    ast.Add: "-",
    ast.Sub: "+",
    ast.BitAnd: "|",
    ast.BitOr: "&",
}


def _comparisons(node: ast.AST, words: dict[type[ast.cmpop], str]) -> Iterator[tuple[ast.AST, str]]:
    if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in words:
        left, right = ast.unparse(node.left), ast.unparse(node.comparators[0])
        yield node, f"({left} {words[type(node.ops[0])]} {right})"


def _boundary(node: ast.AST) -> Iterator[tuple[ast.AST, str]]:
    """``<`` for ``<=``; and ``!=`` for ``==``, ``is not`` for ``is``."""
    return _comparisons(node, _COMPARE)


def _turned(node: ast.AST) -> Iterator[tuple[ast.AST, str]]:
    return _comparisons(node, _TURNED)


def _aggregate(node: ast.AST) -> Iterator[tuple[ast.AST, str]]:
    if isinstance(node, ast.Call):
        name = node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")
        if name in _AGGREGATE and (isinstance(node.func, ast.Attribute) or node.args):
            if (
                name == "max"
                and len(node.args) > 1
                and isinstance(node.args[0], ast.Constant)
                and node.args[0].value == 1
            ):
                return  # no division by zero, no slice of nothing
            function = ast.unparse(node.func).removesuffix(name)
            yield node.func, f"{function}{_AGGREGATE[name]}"


def _lost(node: ast.AST) -> Iterator[tuple[ast.AST, str]]:
    """A magnitude, a root, a conversion that is left out."""
    if isinstance(node, ast.Call) and len(node.args) == 1 and not node.keywords:
        name = node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")
        if name in _DROPPED:
            yield node, f"({ast.unparse(node.args[0])})"


def _truth(node: ast.AST) -> Iterator[tuple[ast.AST, str]]:
    if isinstance(node, ast.BoolOp):
        other = " or " if isinstance(node.op, ast.And) else " and "
        yield node, "(" + other.join(f"({ast.unparse(value)})" for value in node.values) + ")"
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield node, f"({ast.unparse(node.operand)})"
    if isinstance(node, ast.IfExp):
        yield node, f"({ast.unparse(node.orelse)} if {ast.unparse(node.test)} else {ast.unparse(node.body)})"


def _arithmetic(node: ast.AST) -> Iterator[tuple[ast.AST, str]]:
    if isinstance(node, ast.BinOp) and type(node.op) in _ARITHMETIC:
        if any(
            isinstance(side, ast.Constant | ast.JoinedStr) and not _number(side) for side in (node.left, node.right)
        ):
            return
        yield node, f"({ast.unparse(node.left)} {_ARITHMETIC[type(node.op)]} {ast.unparse(node.right)})"


def _number(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool)


def _constant(node: ast.AST) -> Iterator[tuple[ast.AST, str]]:
    """A bound, a unit's factor, a quantile: nine tenths of it; a count or an index: one more."""
    if _number(node):
        value = node.value  # type: ignore[attr-defined]
        yield node, repr(value + 1) if isinstance(value, int) else repr(0.9 * value if value else 0.1)


def _exit(node: ast.AST) -> Iterator[tuple[ast.AST, str]]:
    """A verdict that is not acted on."""
    if isinstance(node, ast.Raise):
        yield node, "pass"


SORTS: dict[str, Finder] = {
    "boundary or identity": _boundary,
    "comparison turned": _turned,
    "other aggregate": _aggregate,
    "magnitude, root or conversion lost": _lost,
    "truth turned": _truth,
    "other arithmetic": _arithmetic,
    "other number": _constant,
    "not raised": _exit,
}


def places(text: str, sort: str, alone: tuple[str, ...] = ()) -> list[Edit]:
    """Every place of a sort in a source, by offsets."""
    lines = [0]
    for line in text.splitlines(keepends=True):
        lines.append(lines[-1] + len(line.encode()))
    encoded = text.encode()

    def offset(row: int, column: int) -> int:
        return len(encoded[: lines[row - 1] + column].decode())

    found = []
    for node in _judging(ast.parse(text), alone):
        for at, new in SORTS[sort](node):
            start = offset(at.lineno, at.col_offset)  # type: ignore[attr-defined]
            end = offset(at.end_lineno, at.end_col_offset)  # type: ignore[attr-defined]
            found.append((start, end, new))
    return found


def _judging(node: ast.AST, alone: tuple[str, ...]) -> Iterator[ast.AST]:
    """All nodes but annotations, texts, looks, and functions to be left alone."""
    if isinstance(node, ast.FunctionDef) and node.name in alone:
        return
    if isinstance(node, ast.JoinedStr | ast.Import | ast.ImportFrom) or _is_text(node):
        return  # what is computed inside a text has no place of its own in Python 3.11's tree: those are listed
    yield node
    for name, field in ast.iter_fields(node):
        if name in {"annotation", "returns", "decorator_list", "defaults", "kw_defaults"}:
            continue
        for child in field if isinstance(field, list) else [field]:
            if isinstance(child, ast.keyword) and child.arg in _LOOKS:
                continue
            if isinstance(child, ast.AST):
                yield from _judging(child, alone)


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _unique(text: str, edit: Edit) -> tuple[str, str]:
    """Old and new text around an edit, long enough to stand once in the file."""
    start, end, new = edit
    first, last = start, end
    while text.count(text[first:last]) != 1:
        first, last = max(0, text.rfind("\n", 0, max(0, first - 1))), text.find("\n", last + 1)
        last = len(text) if last < 0 else last
    return text[first:last], text[first:start] + new + text[end:last]


def judged_mutants(each: int = PLACES, seed: int = SEED) -> list[Mutant]:
    """``each`` sorts of every judging module, where it has so many, a place of each."""
    found = []
    for file, (tests, alone) in JUDGES.items():
        text, rng = (ROOT / file).read_text(encoding="utf-8"), random.Random(f"{seed} {file}")
        every = {sort: places(text, sort, alone) for sort in SORTS}
        sorts = [sort for sort in SORTS if every[sort]]
        for sort in rng.sample(sorts, min(each, len(sorts))):
            start, end, new = rng.choice(every[sort])
            was, line = " ".join(text[start:end].split()), text.count("\n", 0, start) + 1
            old, new_text = _unique(text, (start, end, new))
            name = f"{file.removeprefix('runtime/')}:{line}: {sort}: {was[:70]}"
            reason = EQUIVALENT.get((file, was, new), "")
            check = f"noticed {tests} -m 'not slow'"
            found.append(Mutant("judges, by rule", name, (check,), file, old, new_text, equivalent=reason, sort=sort))
    return found


#: (file, what stood there, what stands there) -> why nothing can tell.
EQUIVALENT: dict[tuple[str, str, str], str] = {}
