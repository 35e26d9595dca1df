"""The rooms: no circle among files or packages, no arrow up the floors, and nothing longer than a person reads."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

pytestmark = pytest.mark.unit

ROOT = Path(__file__).parents[1]
ROOMS = ("model", "codegen", "runtime")

#: Every package once, from the ground up; packages of one floor do not import each other.
FLOORS = (
    ("model",),
    ("model.machines",),
    ("model.drives", "model.filters"),
    ("model.loop", "model.supervisor"),
    ("codegen.ir", "codegen.output"),
    ("codegen.passes", "codegen.targets"),
    ("codegen.fast",),
    ("codegen.evidence",),
    ("codegen.targets.chips",),
    ("codegen.render.printers",),
    ("codegen.render",),
    ("codegen",),
    ("runtime.system",),
    ("runtime.estimator", "runtime.recorded", "runtime.style"),
    ("runtime.folders",),
    ("runtime.drive", "runtime.firmware.static", "runtime.proof.text"),
    (
        "runtime.proof",
        "runtime.replay",
        "runtime.compare",
        "runtime.exports",
        "runtime.faults",
        "runtime.study",
        "runtime.design",
    ),
    ("runtime.firmware", "runtime.board", "runtime.browser", "runtime.identify", "runtime.packages"),
    ("runtime.endurance", "runtime.commission"),
    ("runtime.report",),
    ("runtime.commands",),
    ("runtime",),
)

#: Lines.
LONGEST_FUNCTION, LONGEST_FILE = 60, 400
#: Longer than that, and why.
LONGER: dict[str, str] = {}

Graph = Mapping[str, set[str]]


def modules(root: Path) -> dict[str, Path]:
    """Dotted name -> file, of all rooms below ``root``."""
    found = {}
    for path in sorted(path for room in ROOMS for path in (root / room).rglob("*.py")):
        parts = path.relative_to(root).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imported(path: Path) -> Iterator[str]:
    """The imports of a file, wherever in it, for types too; ``from a import b`` gives ``a.b``."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: a relative import"
            yield from (f"{node.module}.{name.name}" for name in node.names)


def file_graph(root: Path) -> dict[str, set[str]]:
    """Module -> modules of the rooms that it imports."""
    files = modules(root)
    graph: dict[str, set[str]] = {}
    for module, path in files.items():
        names = (name if name in files else name.rpartition(".")[0] for name in imported(path))
        graph[module] = {name for name in names if name in files} - {module}
    return graph


def package_graph(root: Path) -> dict[str, set[str]]:
    """Package -> packages that its own files import; a package inside another is one of its own."""
    files = modules(root)

    def package(module: str) -> str:
        return module if files[module].name == "__init__.py" else module.rpartition(".")[0]

    graph: dict[str, set[str]] = {package(module): set() for module in files}
    for module, targets in file_graph(root).items():
        graph[package(module)] |= {package(target) for target in targets} - {package(module)}
    return graph


def circle(graph: Graph) -> list[str]:
    """A circle of arrows, its first node at both ends; empty if there is none."""
    done: set[str] = set()

    def search(node: str, way: list[str]) -> list[str]:
        if node in way:
            return [*way[way.index(node) :], node]
        if node in done:
            return []
        for target in sorted(graph.get(node, ())):
            if found := search(target, [*way, node]):
                return found
        done.add(node)
        return []

    return next((found for node in sorted(graph) if (found := search(node, []))), [])


def arrows_up(root: Path) -> list[str]:
    """Arrows that do not end on a floor below the one they begin on."""
    floor = {package: height for height, packages in enumerate(FLOORS) for package in packages}
    return [
        f"{package} -> {target}"
        for package, targets in package_graph(root).items()
        for target in sorted(targets)
        if floor[target] >= floor[package]
    ]


def test_every_package_has_one_floor() -> None:
    listed = [package for packages in FLOORS for package in packages]
    assert sorted(listed) == sorted(package_graph(ROOT))


def test_files_and_packages_import_in_no_circle_and_never_upwards() -> None:
    assert circle(file_graph(ROOT)) == []
    assert circle(package_graph(ROOT)) == []
    assert arrows_up(ROOT) == []


SECOND = {"reference", "motors", "inverter", "control", "wrong_data", "modes", "mode_memory", "mode_numbers", "align"}


@pytest.mark.parametrize("alone", sorted(SECOND))
def test_the_second_opinion_imports_nothing_it_is_to_check(alone: str) -> None:
    allowed = {"__future__", "collections", "copy", "dataclasses", "typing", "math", "cmath", "numpy"}
    names = set(imported(ROOT / "runtime" / "proof" / f"{alone}.py"))
    ours = {name for name in names if name.startswith("runtime.proof.")}
    assert {name.split(".")[2] for name in ours} <= SECOND
    assert {name.partition(".")[0] for name in names - ours} <= allowed


def plant(root: Path, texts: Mapping[str, str]) -> None:
    for name, text in texts.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)


def test_a_circle_of_files_is_found_inside_a_function_too(tmp_path: Path) -> None:
    plant(tmp_path, {"model/one.py": "import model.two\n", "model/two.py": "X = 1\n"})
    assert circle(file_graph(tmp_path)) == []
    (tmp_path / "model" / "two.py").write_text("def late():\n    from model import one\n")
    assert circle(file_graph(tmp_path)) == ["model.one", "model.two", "model.one"]
    (tmp_path / "model" / "two.py").write_text("if TYPE_CHECKING:\n    from model.one import X\n")
    assert circle(file_graph(tmp_path)) == ["model.one", "model.two", "model.one"]


def test_a_circle_of_packages_and_an_arrow_up_are_found(tmp_path: Path) -> None:
    plant(
        tmp_path,
        {
            "codegen/passes/__init__.py": "",
            "codegen/passes/one.py": "from codegen.ir.expr import Expr\n",
            "codegen/ir/expr.py": "",
            "codegen/ir/graph.py": "from codegen.passes import one\n",
        },
    )
    assert circle(file_graph(tmp_path)) == []
    assert circle(package_graph(tmp_path)) == ["codegen.ir", "codegen.passes", "codegen.ir"]
    assert arrows_up(tmp_path) == ["codegen.ir -> codegen.passes"]


# --- the documents


def unknown_files(text: str) -> list[str]:
    """Files in backticks that are nowhere in the project, by the end of their path."""
    ours = [
        "/" + path.relative_to(ROOT).as_posix()
        for room in (*ROOMS, "tests", "docs", "benchmarks", "generated")
        for path in (ROOT / room).rglob("*")
    ]
    ours += ["/" + path.name for path in ROOT.iterdir()]
    named = re.findall(r"`([\w./]+\.(?:py|c|h|j2|md|toml)|[\w./]+/)`", text)
    return [name for name in named if not any(path.endswith("/" + name.rstrip("/")) for path in ours)]


@pytest.mark.parametrize("document", ["ARCHITECTURE.md", "CONTRIBUTING.md"])
def test_files_that_documents_name_are_there(document: str) -> None:
    assert unknown_files((ROOT / document).read_text(encoding="utf-8")) == []
    assert unknown_files("`tasks.py`, `model/nowhere/`, `proof/verify.py`") == ["tasks.py", "model/nowhere/"]


# --- sizes


def texts(root: Path) -> Iterator[Path]:
    """The files that people write and read: Python everywhere, C and templates outside the tests."""
    for room in (*ROOMS, "tests", "benchmarks"):
        ends = (".py",) if room == "tests" else (".py", ".c", ".h", ".j2")
        yield from sorted(path for path in (root / room).rglob("*") if path.suffix in ends)


def python_functions(text: str) -> Iterator[tuple[str, int]]:
    """Name and lines of every function; one inside another counts for both."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.end_lineno is not None:
            yield node.name, node.end_lineno - node.lineno + 1


def c_functions(text: str) -> Iterator[tuple[str, int]]:
    """First line and lines of every body whose braces stand alone at the left margin."""
    begin, lines = None, text.splitlines()
    for number, line in enumerate(lines):
        if line == "{":
            begin = number
        elif line == "}" and begin is not None:
            yield lines[begin - 1], number - begin + 1
            begin = None


def too_long(root: Path) -> set[str]:
    """Files, and functions behind a colon, that are longer than allowed."""
    found = set()
    for path in texts(root):
        name, text = path.relative_to(root).as_posix(), path.read_text(encoding="utf-8")
        found |= {name} if len(text.splitlines()) > LONGEST_FILE else set()
        functions = python_functions(text) if path.suffix == ".py" else c_functions(text)
        found |= {f"{name}: {function}" for function, lines in functions if lines > LONGEST_FUNCTION}
    return found


def test_files_and_functions_are_short() -> None:
    assert too_long(ROOT) == set(LONGER)


def test_functions_branch_little() -> None:
    """Ruff counts: it is told to, and how far."""
    lint = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["ruff"]["lint"]
    assert "C901" in lint["select"]
    assert lint["mccabe"]["max-complexity"] == 15
    assert "C901" not in lint["ignore"]


def test_what_is_too_long_is_found(tmp_path: Path) -> None:
    body = "    x = 1\n" * LONGEST_FUNCTION
    plant(
        tmp_path,
        {
            "model/long.py": f"def much():\n{body}",
            "model/most.py": f"def much():\n{body[:-10]}",
            "runtime/long.c": "int much(void)\n{\n" + body + "}\n",
            "tests/long.c": "int much(void)\n{\n" + body + "}\n",
            "codegen/long.j2": "\n" * (LONGEST_FILE + 1),
            "codegen/most.j2": "\n" * LONGEST_FILE,
        },
    )
    assert too_long(tmp_path) == {"model/long.py: much", "runtime/long.c: int much(void)", "codegen/long.j2"}
