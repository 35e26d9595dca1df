"""Expected results of a self-test: the bits of the generated module in float32, and how far the chip may be from them.

The C28x with FPU32 adds and multiplies as IEEE does, but divides and takes roots by Newton steps, each good to
3 units in the last place (published tables; not measured here). So the recorded steps are run again with every
quotient and root off by a random -3 .. 3 units; what the outputs make of that, times a margin, is allowed there.
"""

from __future__ import annotations

import ast
from bisect import bisect_left
from dataclasses import dataclass
from functools import lru_cache
from types import CodeType, SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from codegen.evidence.selftest import ControlRun, Segment

Array = NDArray[Any]

#: Error of one division or square root on the chip, units in the last place.
UNITS = 3
#: Error of a sine or cosine by an instruction, of an angle that is first turned into turns.
TRIG = 2.0**-20
#: Runs with random errors, and how much more than the worst of them is allowed: a run of other errors may do worse.
DRAWS, MARGIN = 64, 8
#: Where a word is 0 in every run: the smallest deviation that is told from 0.
SMALLEST = 2.0**-100


@dataclass(frozen=True)
class Recording:
    """status, iterations (N,); words (N, m) float32; allowed (N, m): biased exponent of the power of two allowed."""

    status: Array
    iterations: Array
    words: Array
    allowed: Array


def execute(module: str, name: str, **replaced: Any) -> dict[str, Any]:
    """Namespace of a generated module; with ``divide`` and ``root``, these in the place of / and np.sqrt.

    Parameters
    ----------
    module : str
        Text of the generated Python module.
    name : str
        The name.
    """
    namespace: dict[str, Any] = {"__name__": name, **replaced}
    exec(_compiled(module)[bool(replaced)], namespace)
    return namespace


@lru_cache(maxsize=1)
def _compiled(module: str) -> tuple[CodeType, CodeType]:
    """The module's code, as it stands and replaced: every filter kind's recordings and certificate run it again."""
    tree = ast.parse(module)
    plain = compile(tree, "generated.py", "exec")
    places = [k for k, line in enumerate(module.split("\n"), 1) if "/" in line or "sqrt" in line]
    return plain, compile(_Replace(places).visit(tree), "generated.py", "exec")


class _Replace(ast.NodeTransformer):
    """Quotients and roots as calls; ``places`` are the lines that may have some, in order: most have none."""

    def __init__(self, places: list[int]) -> None:
        self.places = places

    def visit(self, node: ast.AST) -> Any:
        if isinstance(node, ast.stmt):
            first = bisect_left(self.places, node.lineno)
            if first == len(self.places) or self.places[first] > (node.end_lineno or node.lineno):
                return node
        return super().visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        if not isinstance(node.op, ast.Div):
            return node
        return ast.copy_location(ast.Call(_name("divide", node), [node.left, node.right], []), node)

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        if isinstance(node.func, ast.Attribute) and node.func.attr == "sqrt":
            node.func = _name("root", node)
        return node


def _name(name: str, place: ast.expr) -> ast.Name:
    """A name in the place of something else: the compiler wants to know where a node stands."""
    return ast.copy_location(ast.Name(name, ast.Load()), place)


def approximate(module: str, name: str, seed: int = 1, native: bool = False) -> dict[str, Any]:
    """The module with each quotient and each root off by up to :data:`UNITS`, another error in every lane.

    Parameters
    ----------
    module : str
        Text of the generated Python module.
    name : str
        The name.
    seed : int, optional
        Seed of what is random.
    native : bool, optional
        Sine and cosine are instructions: each is off by up to :data:`TRIG`.
    """
    rng = np.random.default_rng(seed)

    def blur(value: Any) -> Any:
        units = rng.integers(-UNITS, UNITS, np.shape(value), endpoint=True)
        return value + value * (np.float32(2.0**-23) * units.astype(np.float32))

    namespace = execute(module, name, divide=lambda a, b: blur(a / b), root=lambda a: blur(np.sqrt(a)))
    if native:
        math = namespace["MATH"]["float32"]

        def sin_cos(x: Any) -> tuple[Any, ...]:
            errors = rng.uniform(-TRIG, TRIG, (2, *np.shape(x))).astype(np.float32)
            return tuple(value + error for value, error in zip(math.sin_cos(x), errors, strict=True))

        namespace["MATH"] = {**namespace["MATH"], "float32": type("Math", (math,), {"sin_cos": staticmethod(sin_cos)})}
    return namespace


def record_filter(module: str, kind: str, runs: list[Segment], native: bool = False) -> Recording:
    """Bits of x and the covariance's words after every step, and what is allowed around them.

    Parameters
    ----------
    module : str
        Text of the generated Python module.
    kind : str
        Filter kind, such as "ickf".
    runs : list of Segment
        The runs.
    native : bool, optional
        Sine and cosine are instructions.
    """
    exact = run_filter(execute(module, "recorded"), kind, runs, 1)
    blurred = run_filter(approximate(module, "approximate", native=native), kind, runs, DRAWS)[2]
    status, iterations, words = (array[..., 0] for array in exact)
    return Recording(status, iterations, words, allowed_exponents(words, blurred))


def record_control(
    module: str, kind: str, run: ControlRun, gains: tuple[float, ...], native: bool = False
) -> Recording:
    """Duty cycles and integrators after every sample.

    Parameters
    ----------
    module : str
        Text of the generated Python module.
    kind : str
        Filter kind, such as "ickf".
    run : ControlRun
        The controller's inputs.
    gains : tuple of float
        The controller's gains, in the order of the struct.
    native : bool, optional
        Sine and cosine are instructions.
    """
    exact = run_control(execute(module, "recorded"), kind, run, gains, 1)
    blurred = run_control(approximate(module, "approximate", native=native), kind, run, gains, DRAWS)[1]
    status, words = (array[..., 0] for array in exact)
    return Recording(status, np.zeros_like(status), words, allowed_exponents(words, blurred))


def run_filter(module: dict[str, Any], kind: str, runs: list[Segment], lanes: int) -> tuple[Array, Array, Array]:
    """status, iterations (N, lanes) and words (N, n + n(n+1)/2, lanes) over all segments, one after another.

    Parameters
    ----------
    module : dict
        Namespace of the generated Python module.
    kind : str
        Filter kind, such as "ickf".
    runs : list of Segment
        N steps in all.
    lanes : int
        Copies side by side; they differ where the module's arithmetic does.

    Returns
    -------
    status, iterations : ndarray, (N, lanes)
    words : ndarray, (N, n + n(n+1)/2, lanes)
        State in the model's units, then the covariance as the filter carries it; float32.
    """
    status, iterations, words = [], [], []
    for run in runs:
        state = _in_lanes(module, module["new_filter"](np.float32, x_0=tuple(run.x_0), P_0=tuple(run.P_0)), lanes)
        for u, y in zip(run.u, run.y, strict=True):
            with np.errstate(all="ignore"):
                code = module["STEPS"][kind](state, _lanes(u, lanes), _lanes(y, lanes), module["MATH"]["float32"])
            status.append(np.broadcast_to(code, lanes))
            iterations.append(np.broadcast_to(state.iterations, lanes))
            words.append(np.array([*state.x, *getattr(state, module["COVARIANCE"])], dtype=np.float32))
    return np.array(status), np.array(iterations), np.array(words)


def run_control(
    module: dict[str, Any], kind: str, run: ControlRun, gains: tuple[float, ...], lanes: int
) -> tuple[Array, Array]:
    """status (N, lanes) and words (N, 7, lanes): duty cycles, integrators.

    Parameters
    ----------
    module : dict
        Namespace of the generated Python module.
    kind : str
        Filter kind, such as "ickf".
    run : ControlRun
        N samples.
    gains : tuple of float
        The controller's gains, in the order of the struct.
    lanes : int
        Copies side by side; they differ where the module's arithmetic does.

    Returns
    -------
    status : ndarray, (N, lanes)
    words : ndarray, (N, 7, lanes)
        Duty cycles of phases a, b, c; integrators of speed (N m), d and q current (V), weakening (A); float32.
    """
    c = module["new_controller"](np.float32, gains, delay=run.delay)
    _in_lanes(module, c.filter, lanes)
    for name in ("integrator", "command_held", "v_acting", "v_queued"):
        setattr(c, name, _lanes(getattr(c, name), lanes))
    status, words = [], []
    for phase, command in zip(run.phase, run.command, strict=True):
        with np.errstate(all="ignore"):
            duty, code = module["foc_step"](
                c, module["STEPS"][kind], _lanes(phase, lanes), _lanes(command, lanes), module["MATH"]["float32"]
            )
        status.append(np.broadcast_to(code, lanes))
        words.append(np.array([*duty, *c.integrator], dtype=np.float32))
    return np.array(status), np.array(words)


def allowed_exponents(words: Array, blurred: Array) -> Array:
    """Biased exponents of the powers of two at or above margin times the worst deviation, per word.

    At least four units in the last place of the word itself.

    Parameters
    ----------
    words : ndarray, (N, m)
        Words of the struct, float32.
    blurred : ndarray, (N, m, draws)
        The same with random errors in quotients and roots.

    Raises
    ------
    FloatingPointError
        A word is no number.
    """
    if not np.all(np.isfinite(words)):
        raise FloatingPointError("the self-test's own trajectory does not stay a number")
    deviation = np.max(np.abs(blurred.astype(float) - words.astype(float)[..., None]), axis=-1)
    least = np.maximum(np.abs(words.astype(float)) * 2.0**-21, SMALLEST)
    bound = np.maximum(MARGIN * np.where(np.isfinite(deviation), deviation, np.inf), least)
    return np.asarray(np.ceil(np.log2(np.minimum(bound, 2.0**100))).astype(int) + 127)


def _in_lanes(module: dict[str, Any], state: SimpleNamespace, lanes: int) -> SimpleNamespace:
    """A filter whose estimate is the same in every lane."""
    for name in ("x", "x_0", "P_0", module["COVARIANCE"], "u_held"):
        setattr(state, name, _lanes(getattr(state, name), lanes))
    return state


def _lanes(values: Any, lanes: int) -> tuple[Array, ...]:
    return tuple(np.full(lanes, value, dtype=np.float32) for value in values)
