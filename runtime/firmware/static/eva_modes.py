"""Gate: Frama-C's EVA proves that one interrupt of the supervisor makes no run-time error, whatever its integers hold.

The supervisor's integers may be all that 16 bits hold, modes and counts that are none among them: so no count
overflows the chip's int, from any memory. Its reals lie in :data:`REALS`, far beyond what they reach; filter and rival
in the box of the filter's own proof (:mod:`runtime.firmware.static.box`), but for the speed, which may have run away;
currents to twice what a filter accepts.

Beside the facts about sine and cosine that :mod:`runtime.firmware.static.eva` hands over there is one more. In
``size = sqrt(larger(a a + b b, least))`` intervals forget that a a is part of what the root is of, so ``a / size`` may
be anything. It is not: rounding keeps order, so the sum is no less than a a as it was rounded, nor size than |a| but
for a rounding of each; where a a is less than ``least``, and may have lost its digits, size is the root of ``least``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from codegen.output.folder import read_manifest
from runtime.firmware.static.box import Interval, filter_box, known_machine
from runtime.firmware.static.check import Check
from runtime.firmware.static.eva import NAME, Verdict, analyse, anything_in, check_of, covariance_field, with_contract
from runtime.firmware.static.tool import missing

#: Of what the supervisor keeps, by field and place in it.
REALS: Mapping[str, tuple[Interval, ...]] = {
    "turning": (*[Interval.within(1e5)] * 2, Interval.within(10.0), Interval.within(1e11), Interval.within(1e5)),
    "silent": (Interval.within(1e5),) * 3,
    "eased": (Interval(0.0, 1.0),),
    "asked": (Interval.within(1e6),),
    "probe": (Interval.within(1.0), Interval(0.0, 32_767.0)),
    "reading": (*[Interval.within(1.1)] * 2, Interval(0.0, 1e6), Interval.within(3.0)),
    "first": (Interval.within(1.1),) * 2,
    "guess": (*[Interval.within(1e6)] * 3, Interval.within(10.0)),
    "spread": (Interval(0.0, 1e10),) * 2,
    "aligning": (Interval(0.0, 2.0),),
    "axis": (*[Interval.within(1.1)] * 2, Interval(0.0, 1e6)),
    "missing": (Interval.within(1e7),) * 2,
}
#: What a part of a vector is at most of its length: 1 but for a few roundings, those of the chip's root included.
MOST_OF_LENGTH = 1.001
#: The length of which that is true.
_LENGTH = re.compile(
    r"const float32 size = PMSM_SQRT\(larger\((?P<a>\w+) \* (?P=a) \+ (?P<b>\w+) \* (?P=b), LEAST_SIZE\)\);"
)
#: An estimated speed that has run away, rad/s.
RUNAWAY = Interval.within(1e6)
#: Speed reference, rad/s.
REFERENCE = Interval.within(1e6)


def mode_checks(folder: Path) -> list[Check]:
    """One check a supervisor of the folder.

    Parameters
    ----------
    folder : Path
        A generated one.
    """
    absent = missing(NAME, f"{folder.name}, supervisor", "frama-c")
    if absent:
        return [absent]
    manifest = read_manifest(folder)
    kinds = [kind for kind in manifest["filters"] if f"{manifest['drive']}_{kind}_supervisor.c" in manifest["files"]]
    return [mode_check(folder, kind) for kind in kinds]


def mode_check(folder: Path, kind: str) -> Check:
    """EVA on one supervisor.

    Parameters
    ----------
    folder : Path
    kind : str
        Of the filter it is around.
    """
    manifest = read_manifest(folder)
    name, subject = f"{manifest['drive']}_{kind}_supervisor", f"{folder.name}, {kind}_supervisor"
    if not known_machine(manifest):
        reason = f"{name}: not proved. EVA was not run: no bounds on this machine's states are known."
        return Check(NAME, subject, "not proved", "no box", "EVA needs a box of states", (reason,))
    return check_of(analyse_modes(folder, f"{manifest['drive']}_{kind}"), subject, name, "one interrupt from any state")


def analyse_modes(folder: Path, prefix: str) -> Verdict:
    """Run EVA on a driver that calls ``<prefix>_supervise`` once, from the box.

    Parameters
    ----------
    folder : Path
    prefix : str
        Of the filter.
    """
    names = [f"{prefix}.c", f"{prefix}_supervisor.c"]
    files = {name: with_directions(with_contract((folder / name).read_text(encoding="utf-8"))) for name in names}
    return analyse({**files, "driver.c": driver(folder, prefix)}, folder)


def with_directions(source: str) -> str:
    """The source with what is known of a direction behind its cosine and sine, where it has one.

    Parameters
    ----------
    source : str
        C.
    """
    length = _LENGTH.search(source)
    if length is None:
        return source
    fact = rf"\g<0> /*@ assert range: -{MOST_OF_LENGTH} <= \g<1> <= {MOST_OF_LENGTH}; */"
    return re.sub(rf"const float32 (\w+) = (?:{length['a']}|{length['b']}) / size;", fact, source)


def driver(folder: Path, prefix: str) -> str:
    """C of a caller whose supervisor, filter and inputs may be anything in the box.

    Parameters
    ----------
    folder : Path
    prefix : str
        Of the filter.
    """
    header = (folder / f"{prefix}_supervisor.h").read_text(encoding="utf-8")
    manifest = read_manifest(folder)
    speed = [state["name"] for state in manifest["states"]].index("omega")
    box = filter_box(manifest, covariance_field(folder, prefix)).replaced(**{f"f.x[{speed}]": RUNAWAY}).places
    current = box["y[0]"]
    places = {place: interval for place, interval in box.items() if place.startswith("f.")}
    if re.search(rf"^    {prefix}_t rival;", header, re.M):
        places |= {f"s.rival.{place.removeprefix('f.')}": interval for place, interval in places.items()}
    for name, size in re.findall(r"^    float32 (\w+)\[(\d+)\];", header, re.M):
        places |= {f"s.{name}[{k}]": REALS[name][k] for k in range(int(size))}
    places |= {"phase[0]": current, "phase[1]": current, "reference": REFERENCE}
    integers = [f"s.{name}" for name in re.findall(r"^    int (\w+);", header, re.M)]
    return "\n".join(
        [
            f'#include "{prefix}_supervisor.h"',
            '#include "__fc_builtin.h"',
            f"static {prefix}_t f;",
            f"static {prefix}_supervisor_t s;",
            "int proof(void);",
            "int proof(void)",
            "{",
            "    float32 phase[2];",
            "    float32 reference;",
            "    int status;",
            f"    {prefix}_init(&f);",
            f"    {prefix}_supervisor_init(&s);",
            *(f"    {place} = {anything_in(interval)}" for place, interval in places.items()),
            *(f"    {place} = Frama_C_interval(-32768, 32767);" for place in ("status", *integers)),
            f"    return {prefix}_supervise(&s, &f, status, phase, reference);",
            "}\n",
        ]
    )
