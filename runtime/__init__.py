"""Everything that runs: the estimator over generated code, the NumPy reference, the proof, the command line.

>>> from runtime import load
>>> f = load("paper_spmsm", filter="ckf")
>>> f.state_names
('i_alpha', 'i_beta', 'omega', 'theta')
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from runtime.estimator import Estimator, Trace, load
    from runtime.system.errors import UserError

__all__ = ["Estimator", "Trace", "UserError", "load"]


def __getattr__(name: str) -> Any:
    """Load what is asked for: the command line watches for Ctrl-C before NumPy begins to load."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module("runtime.system.errors" if name == "UserError" else "runtime.estimator"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
