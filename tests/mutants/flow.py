"""Mutants of the flow: guards, branches, masks, status bits, loops and restarts of every emitted text, by rule.

Each of C, lanes and module states the whole step, so each error in one of them must be noticed by link ``text`` alone:
nothing is run. The places are of all functions, blocks among them, for a branch is a branch.
"""

from __future__ import annotations

import random
import re
from collections.abc import Iterator

from tests.mutants.emitted import GENERATED, SEED, Code, Operator, _pattern, emitted_mutants
from tests.mutants.mutant import Mutant

#: Drives and the filter whose texts are drawn from: both filters, two machines, an adaptive one.
SUBJECTS = (("paper_spmsm", "ckf"), ("ipmsm_flux", "ickf"), ("ipmsm_adaptive", "ickf"))

_TURNED = {"<=": ">", "<": ">=", ">": "<=", ">=": "<", "==": "!=", "!=": "=="}
_MET = {"<=": "<", "<": "<=", ">": ">=", ">=": ">"}
_COMPARED = r" (<=|>=|==|!=|<|>) (?=[\w(-])"
_LIMITS = (
    *("SANE_LIMIT", "PER_SANE_LIMIT", "SMALL_TURN", "UNKNOWN_TURN", "MOST_REPAIRS", "SENSED_MAX"),
    *("f->nis_max", "f->tolerance", "f->max_iterations", "f->nis_weight"),
    *("f.nis_max", "f.tolerance", "f.max_iterations", "f.nis_weight"),
)
_BITS = "INPUT_REJECTED|NOT_CONVERGED|COMMAND_REJECTED|COVARIANCE_REPAIRED|DIVERGED|RESTARTED"


def _other_limit(match: re.Match[str]) -> str:
    """A limit's number twice as large, or another field of the same struct."""
    own, _, field = match[1].rpartition("->" if "->" in match[1] else ".")
    if not own:
        return f"({match[1]} + {match[1]})"
    return match[1].replace(field, {"nis_max": "tolerance", "nis_weight": "nis_max"}.get(field, "nis_max"))


def _arms(match: re.Match[str]) -> str:
    return f"? {match[2]} : {match[1]}"


def _code(pattern: str) -> str:
    """The pattern, but neither in a macro's definition nor in a loop's head."""
    return rf"(?<!#define )(?<!for \(){pattern}"


OPERATORS: dict[str, Operator] = {
    "a guard turned": _pattern(_COMPARED, lambda m: f" {_TURNED[m[1]]} ", steering=True),
    "a limit that is met": _pattern(r" (<=|>=|<|>) (?=[\w(-])", lambda m: f" {_MET[m[1]]} ", steering=True),
    "another limit": _pattern(
        _code(rf"(?<![\w.>])({'|'.join(map(re.escape, _LIMITS))})\b(?! \d|\[)(?! =)"), _other_limit, steering=True
    ),
    "a status bit not set": _pattern(rf"(?<=[:,|] )(?:PMSM_)?(?:{_BITS})\b", lambda m: "0", steering=True),
    "arms exchanged": _pattern(r"\? ([\w.\[\]]+) : ([\w.\[\]]+)", _arms, steering=True),
    "arms exchanged, Python": _pattern(
        r"(np\.where|_select)\((\w+(?: \| \([^()]*\))?), ([\w.]+), ([\w.]+)\)",
        lambda m: f"{m[1]}({m[2]}, {m[4]}, {m[3]})",
        steering=True,
    ),
    "and for or": _pattern(r" (&&|\|\||&|\|) (?=\S)", lambda m: f" {_OTHER[m[1]]} ", steering=True),
    "a call or a store left out": _pattern(
        r"^( +)(?:\w+\((?:[^();]|\([^();]*\))*\)|(?:f->\w+(?:\[\w+\])?|\w+\[\w+\]) = [^;]*|\w+\+\+|\w+ \|= [^;]*);$",
        lambda m: f"{m[1]};",
        steering=True,
    ),
    "a loop one short": _pattern(
        r"(?<= < )(N_STATES|N_WORDS|LANES|count|[2-9])(?=; )", lambda m: f"{m[1]} - 1", steering=True
    ),
}
_OTHER = {"&&": "||", "||": "&&", "&": "|", "|": "&"}


#: Functions that no step calls; tests of their own try them.
ASIDE = ("_init", "_reset", "_load", "new_filter", "new_controller", "unpack")


def files(drive: str, kind: str) -> Iterator[str]:
    stem = f"{drive}_{kind}"
    yield from (f"{stem}{end}.c" for end in ("", "_foc", "_supervisor", "_drive"))
    yield from (f"host/{stem}_lanes.c", f"host/{stem}_foc_lanes.c", f"{drive}.py")


def flow_mutants(places: int = 1, seed: int = SEED) -> list[Mutant]:
    """So many places of each operator in every text of the step; not what is drawn of the emitted text already."""
    found: list[Mutant] = []
    drawn = {(mutant.file, mutant.text) for mutant in emitted_mutants(places, seed)}
    for drive, kind in SUBJECTS:
        for file in files(drive, kind):
            text = (GENERATED / drive / file).read_text(encoding="utf-8")
            code = Code.python(text) if file.endswith(".py") else Code.c(text)
            rng = random.Random(f"{seed} {file} flow")
            for sort, operator in OPERATORS.items():
                edits = [edit for edit in operator(code) if not _aside(code, kind, edit[0])]
                for start, end, new in rng.sample(edits, min(places, len(edits))):
                    line = " ".join(text[text.rfind("\n", 0, start) + 1 :].split("\n", 1)[0].split())
                    place = f"{code.function(start)[0]}: {line[:70]} ({start}: {new.strip()[:20]})"
                    found.append(
                        Mutant(
                            kind="flow",
                            name=f"{file}: {sort} in {place}",
                            checks=(f"text {drive} {kind}",),
                            file=f"{drive}/{file}",
                            text=text[:start] + new + text[end:],
                            group=f"step {drive} {kind}",
                            sort=sort,
                        )
                    )
    return [mutant for mutant in found if (mutant.file, mutant.text) not in drawn]


def _aside(code: Code, kind: str, at: int) -> bool:
    """What no step reaches: functions of the other filter, of words' reading, and what is called at the start."""
    name = code.function(at)[0]
    return not name or name.startswith("ickf" if kind == "ckf" else "ckf") or name.endswith(ASIDE)
