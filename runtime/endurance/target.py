"""A generated filter or controller as a target: its sources, its words, and how one input played on it ends."""

from __future__ import annotations

import ctypes
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from runtime.estimator.compiler import build_library
from runtime.estimator.folder import GeneratedFolder
from runtime.folders.resolve import drive_folder

HERE = Path(__file__).parent
HANDWRITTEN = ("fuzz_target.c", "fuzz_judge.h", "fuzz_lanes.h")

#: The subject of a test: the filter, the filter and its lane form side by side, or the controller around it.
FORMS = ("", "_lanes", "_foc")

#: The judge's verdicts, in the order of fuzz_judge.h.
KINDS = (
    "good",
    "state not finite, unsaid",
    "covariance not finite, unsaid",
    "theta outside [-pi, pi), unsaid",
    "pivot negative, unsaid",
    "Q or R not finite, unsaid",
    "more iterations than asked for",
    "duty cycle outside [0, 1]",
    "lane form differs",
)

#: Fields that stay as they are: the gains are the designer's affair, and nothing in a controller judges them.
LEFT_ALONE = ("gain",)
#: Integers that the step only writes, or that operations set in a range of their own.
OWN_RANGE = ("max_iterations", "iterations")


@dataclass(frozen=True)
class Verdict:
    """How an input ended: ``kind`` an index of :data:`KINDS`, the word and step at fault, the last step's status."""

    kind: int
    word: int
    step: int
    status: int


class _Verdict(ctypes.Structure):
    _fields_ = [(name, ctypes.c_int) for name in ("kind", "word", "step", "status")]


@dataclass(frozen=True)
class Target:
    """A filter of a generated folder in one of :data:`FORMS`."""

    folder: GeneratedFolder
    kind: str
    form: str = ""

    @property
    def core(self) -> str:
        """The generated function's prefix."""
        return f"{self.folder.drive}_{self.kind}"

    @property
    def name(self) -> str:
        """The target's name in tables and files."""
        return f"{self.core}{self.form}"

    @property
    def controller(self) -> bool:
        """Whether it is a controller."""
        return self.form == "_foc"

    @property
    def _main(self) -> str:
        return self.name if self.controller else self.core

    @cached_property
    def sources(self) -> dict[str, str]:
        """File name -> text: what is generated, and the player."""
        stems = [self.core, *{"_foc": [self.name], "_lanes": [f"host/{self.name}"]}.get(self.form, [])]
        names = ["pmsm_port.h", *(f"{stem}{end}" for stem in stems for end in (".h", ".c"))]
        texts = {Path(name).name: self.folder.text(name) for name in names}
        return {**texts, **{name: (HERE / name).read_text(encoding="utf-8") for name in HANDWRITTEN}}

    @cached_property
    def fields(self) -> tuple[list[str], list[str]]:
        """Entries of the macros WORDS and INTEGERS: F(field of the filter), G(field of the controller)."""
        words, integers = self._of("F", self.core)
        if self.controller:
            more, counters = self._of("G", self.name)
            words, integers = words + more, integers + counters
        return words, integers

    def _of(self, macro: str, prefix: str) -> tuple[list[str], list[str]]:
        header = _plain(self.sources[f"{prefix}.h"])
        found = re.search(rf"typedef struct \{{([^}}]*)\}} {prefix}_t;", header)
        assert found is not None, prefix
        words = [n for n in re.findall(r"float32 (\w+)", found[1]) if n not in LEFT_ALONE]
        integers = [n for n in re.findall(r"int (\w+)", found[1]) if n not in OWN_RANGE]
        return [f"{macro}({n})" for n in words], [f"{macro}({n})" for n in integers]

    @property
    def defines(self) -> dict[str, str]:
        """Macros that say to fuzz_target.c what it plays."""
        words, integers = self.fields
        names = [state["name"] for state in self.folder.manifest["states"]]
        values = {
            "FILTER": self._main,
            "CORE": self.core,
            "HEADER": f'"{self._main}.h"',
            "N_STATES": str(len(names)),
            "THETA": str(names.index("theta")),
            "WORDS(F,G)": " ".join(words),
            # a filter without counters has one word to change in their place: its passes, which every step bounds
            "INTEGERS(F,G)": " ".join(integers or ["F(max_iterations)"]),
        }
        if self.form == "_lanes":
            header = _plain(self.sources[f"{self.name}.h"])
            values["LANES_HEADER"] = f'"{self.name}.h"'
            values["LANE_WORDS(F)"] = " ".join(f"F({name})" for name in re.findall(r"\n    lanes (\w+)\[", header))
            integers = [name for name in re.findall(r"\n    int (\w+)\[LANES", header) if name != "status"]
            values["LANE_INTEGERS(F)"] = " ".join(f"F({name})" for name in integers)
        return {**values, "CONTROLLER": "1"} if self.controller else values

    def replayer(self) -> Replayer:
        """The target compiled by the system's compiler."""
        return Replayer(build_library(self.sources, self.defines))


def _plain(header: str) -> str:
    """A header without its comments."""
    return re.sub(r"/\*.*?\*/", "", header, flags=re.DOTALL)


class Replayer:
    """Plays inputs, one at a time."""

    def __init__(self, library: Path) -> None:
        self._library = ctypes.CDLL(str(library))
        self._features = int(self._library.fuzz_features())

    def play(self, data: bytes) -> tuple[Verdict, frozenset[int]]:
        """The verdict on an input, and which features it shows."""
        verdict = _Verdict()
        seen = (ctypes.c_uint8 * self._features)()
        self._library.fuzz_replay(data, len(data), ctypes.byref(verdict), seen)
        said = Verdict(*(getattr(verdict, name) for name, *_ in _Verdict._fields_))
        return said, frozenset(i for i, count in enumerate(seen) if count)


def targets(drive: str) -> list[Target]:
    """Every filter of a generated folder, then each beside its lane form, then every controller.

    Parameters
    ----------
    drive : str
        A shipped name, the path of a TOML file, or a generated folder.
    """
    folder = drive_folder(drive)
    return [Target(folder, kind, form) for form in FORMS for kind in folder.kinds]
