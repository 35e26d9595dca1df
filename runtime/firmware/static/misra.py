"""Gate: MISRA C:2012 as cppcheck's addon sees it, on the chip's data model and as its compiler preprocesses.

Required rules are kept without exception. Advisory rules are kept too, or a deviation gives the reason:
``misra.toml`` holds both tables. The addon does not implement every rule; what it cannot see is not judged here.
"""

from __future__ import annotations

import re
import shutil
import tempfile
import tomllib
from collections import Counter
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

from codegen.targets.find import default_target
from runtime.firmware.static.check import Check
from runtime.firmware.static.subset import target_of
from runtime.firmware.static.tool import OTHER_EXAMPLE, firmware_sources, is_example, missing, run

NAME = "MISRA C:2012"
TABLE = Path(__file__).with_name("misra.toml")
PLATFORM = Path(__file__).with_name("c28x.xml")

#: What TI's compilers define beside a target's macros; no other text asks for them.
TI_DEFINES = {"__TI_STRICT_FP_MODE__": "1", "__TI_COMPILER_VERSION__": "22006000"}

_LINE = re.compile(r"^(?P<file>[^|]*)\|(?P<line>\d+)\|(?P<severity>\w+)\|(?P<id>[\w.-]+)\|(?P<message>.*)$")


@dataclass(frozen=True)
class Finding:
    """One message of cppcheck; ``rule`` is empty where it is cppcheck's own."""

    place: str
    severity: str
    rule: str
    message: str


@cache
def rules() -> dict[str, dict[str, str]]:
    """Rule number to category and meaning."""
    return dict(tomllib.loads(TABLE.read_text(encoding="utf-8"))["rules"])


@cache
def deviations() -> dict[str, str]:
    """Advisory rules the project does not follow, with the reason."""
    return dict(tomllib.loads(TABLE.read_text(encoding="utf-8"))["deviations"])


def category(rule: str) -> str:
    """Return a rule's category: mandatory, required or advisory."""
    return rules()[rule]["category"] if rule in rules() else "required"


def misra_checks(folder: Path) -> list[Check]:
    """One check: all firmware files of a folder at once, because some rules look across files.

    cppcheck leaves its dumps beside what it reads, so it reads a copy.
    """
    with tempfile.TemporaryDirectory() as scratch:
        copied = Path(scratch) / folder.name
        shutil.copytree(folder, copied)
        return _checks(copied)


def _checks(folder: Path) -> list[Check]:
    absent = missing(NAME, folder.name, "cppcheck")
    if absent:
        return [absent]
    sources = firmware_sources(folder)
    findings = find(folder, sources) if sources else []
    examples = [source for source in sources if is_example(source)]
    if examples:  # the other way of the example; no other file asks which it is
        findings = list(dict.fromkeys([*findings, *find(folder, examples, f"-D{OTHER_EXAMPLE}")]))
    count = Counter(finding.rule for finding in findings if finding.rule)
    broken = [f for f in findings if not f.rule and f.severity in {"error", "warning"}]
    required = [f for f in findings if f.rule and category(f.rule) != "advisory"]
    unexplained = [f for f in findings if f.rule and category(f.rule) == "advisory" and f.rule not in deviations()]
    bad = [*broken, *required, *unexplained]
    explained = {rule for rule in count if category(rule) == "advisory" and rule in deviations()}
    figure = f"{len(required)} required, {sum(count.values()) - len(required)} advisory in {len(sources)} files"
    detail = [f"{f.place}: {_words(f)}" for f in bad]
    if explained and not bad:
        followed = ", ".join(sorted(explained, key=_order))
        detail = [f"MISRA: advisory rules not followed: {followed}; docs/misra.md has the reasons"]
    how = "cppcheck's addon, chars of 16 bits, as the target's compiler preprocesses"
    state: Literal["passed", "failed"] = "failed" if bad or not sources else "passed"
    return [Check(NAME, folder.name, state, figure, how, tuple(detail))]


def find(folder: Path, sources: list[Path], *options: str) -> list[Finding]:
    """The findings of cppcheck, one a a place and rule."""
    # Ints of 16 bits for every target: the text must hold there. Where chars have 8, the addon takes a status bit for a
    # char that is assigned to an int (rule 10.6): that is not judged here.
    macros = dict(target_of(folder).compiler.macros) | default_target().data.macros | TI_DEFINES
    command = ["cppcheck", f"--platform={PLATFORM}", "--addon=misra", "--enable=style,warning", "--std=c89", "--quiet"]
    command += ["--max-configs=1", "--template={file}|{line}|{severity}|{id}|{message}"]
    command += [f"-D{name}={value}" for name, value in macros.items()]
    code, text = run([*command, f"-I{folder}", *options, *map(str, sources)])
    found = dict.fromkeys(filter(None, map(_finding, text.splitlines())))
    if code and not found:
        return [Finding("cppcheck", "error", "", text.strip()[-300:])]
    return list(found)


def _finding(line: str) -> Finding | None:
    match = _LINE.match(line)
    if match is None:  # cppcheck's own failures come without the template
        return Finding("cppcheck", "error", "", line.strip()) if "rror" in line else None
    rule = match["id"].removeprefix("misra-c2012-") if match["id"].startswith("misra-c2012-") else ""
    place = f"{Path(match['file']).name}:{match['line']}"
    return Finding(place, match["severity"], rule, match["message"])


def _words(finding: Finding) -> str:
    if not finding.rule:
        return finding.message
    about = rules()[finding.rule]["about"] if finding.rule in rules() else "not in the table, so taken as required"
    return f"rule {finding.rule} ({category(finding.rule)}): {about}"


def _order(rule: str) -> tuple[int, ...]:
    return tuple(int(part) for part in rule.split("."))
