"""Every option of every command with whatever one can type: taken, or refused in one line; never a traceback.

Options are drawn from the command line itself, each with words of its own type. What would take time is stopped
where it begins: compiling, generating, a comparison. Everything before is done: there words become values.
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from runtime.system.errors import UserError
from tests.runtime.bad_inputs.place import COMMANDS, make_place
from tests.runtime.hostile import command as run

#: Where work begins.
WORK = (
    "runtime.estimator.compiler.put_into_cache",
    "runtime.folders.generate.generate",
    "runtime.folders.current.generate",
    "runtime.design.trial.package",
    "runtime.compare.subject.collect",
    "runtime.study.cluster._connect",
    "runtime.commission.session.SimulatedMotor",
)
#: Words that somewhere are the right ones.
WORDS = (
    *(
        "ckf",
        "ickf",
        "ckf,ickf",
        "c",
        "numpy",
        "float64",
        "pwm",
        "averaged",
        "load_step",
        "all",
        "literal",
        "cortex_m7",
    ),
    *("R=1.1", "R=0.5:2", "noise=1:2:log", "load=0:1:rated", "R,L", "psi_m", "t=ms", "i_alpha=-1", "bac", "0,0,0,0"),
    *("simulated", "bits", "single", "filter", "motor", "c28x", "0x100", "cmake", "swapped", "[/b]", "paper_spmsm"),
)
#: Files of the place, and some that are not there.
PATHS = ("good.npz", "good.csv", "facts.toml", "good.toml", "a_file", "a_folder", "x/y", "new.toml", "new.npz", "new.c")
TEXT = st.text(st.characters(exclude_categories=("Cs",), exclude_characters="\0"), max_size=12)
NUMBERS = st.floats().map(str) | st.integers(-50, 50).map(str) | st.integers(10**12).map(str)

#: What goes before the options, so that the command has all it needs.
ARGUMENTS = {"facts": ["facts.toml"], "drive": ["paper_spmsm"], "drives": ["paper_spmsm"], "data": ["good.npz"]}
REQUIRED = {"system": "--for=cmake", "out": "--out=o.c", "port": "--port=simulated", "facts": "--facts=facts.toml"}


def texts(param: Any) -> st.SearchStrategy[str]:
    """What is typed behind an option."""
    kind = param.type_descriptor.annotation
    if kind is Path:
        return st.sampled_from(PATHS) | TEXT.map(lambda text: text.replace("/", "_"))
    return (NUMBERS if kind in (int, float) else st.sampled_from(WORDS)) | TEXT


@st.composite
def lines(draw: st.DrawFn) -> list[str]:
    """A command with its arguments, and some of its options."""
    name = draw(st.sampled_from(sorted(COMMANDS)))
    params = COMMANDS[name].params
    words = name.split()
    for param in params:
        if param.param_type_name == "argument":
            words += ARGUMENTS.get(param.name, []) if name != "record" else []
        elif param.required:
            words.append(REQUIRED[param.name])
    options = [param for param in params if param.param_type_name == "option" and param.name != "help"]
    for param in draw(st.lists(st.sampled_from(options), max_size=3, unique_by=lambda param: param.name)):
        flag = param.type_descriptor.annotation is bool
        words.append(param.opts[0] if flag else f"{param.opts[0]}={draw(texts(param))}")
    return words


@pytest.fixture(scope="module")
def _place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A folder with files of every kind, in which nothing is worked."""
    before, folder = Path.cwd(), tmp_path_factory.mktemp("any")
    make_place(folder)

    def begins(*words: Any, **keys: Any) -> NoReturn:
        raise UserError("here work begins.")

    with pytest.MonkeyPatch.context() as patch:
        for place in WORK:
            patch.setattr(place, begins)
        patch.setenv("PMSM_ICKF_CACHE", str(folder / "cache"))
        os.chdir(folder)
        try:
            yield
        finally:
            os.chdir(before)


@pytest.mark.usefixtures("_place")
@settings(
    derandomize=True, deadline=None, max_examples=25 * settings.default.max_examples,  # type: ignore[attr-defined]
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)  # fmt: skip
@given(lines())
@example(["study", "map", "paper_spmsm", "--filter=pf"])
@example(["pil", "--port=simulated", "--baud=1000000000000"])
@example(["simulate", "--factors=R=1e308"])
def test_any_words_are_taken_or_refused_in_a_line(words: list[str]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.stdin", io.StringIO())
        code, said = run(*words)
    lines = [line for line in said.splitlines() if "caution: " not in line]
    assert code in {0, 1, 2}, said
    assert code != 2 or (len(lines) == 1 and lines[0].startswith("pmsm-ickf: ")), said
    assert all(line.isprintable() for line in lines)
