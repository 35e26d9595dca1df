"""Link D-chip: float32 on the host against the chip's arithmetic as modelled, running free side by side.

The model (:mod:`codegen.evidence.fpu32`) divides and takes roots by Newton steps and flushes denormals. What this link
says is modelled, not measured; it is the expectation that the user's own board is later compared with.
"""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from codegen.evidence.fpu32 import FPU32, Flushed
from codegen.targets.find import find_target
from model.schema import DEFAULT_TARGET
from runtime.estimator.estimator import Estimator, load_folder
from runtime.estimator.folder import GeneratedFolder
from runtime.estimator.numpy_backend import NumpyBackend
from runtime.proof.link_cd import drift, drift_rows
from runtime.proof.result import Link

Array = NDArray[Any]


class ChipBackend(NumpyBackend):
    """The generated float32 Python, every number of it wrapped in a modelled arithmetic."""

    def __init__(
        self, module: ModuleType, kind: str, number: type[Flushed] = FPU32, sin_cos: Callable[..., Any] | None = None
    ) -> None:
        super().__init__(module, kind, "float32")
        self.number = number
        if sin_cos is not None:
            self.math = type("Math", (self.math,), {"sin_cos": staticmethod(sin_cos)})
        self.filter = module.new_filter(lambda value: number(np.float32(value)))

    def _wrap(self, value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(self.number(item) for item in value)
        return value if isinstance(value, int) else self.number(value)

    def reset(self, x0: Array, words: Array) -> None:
        """Start from a state and covariance words.

        Parameters
        ----------
        x0 : ndarray
            State to start from.
        words : ndarray
            Words of the struct.
        """
        super().reset(x0, words)
        for name in ("x", self._covariance, "u_held"):
            setattr(self.filter, name, self._wrap(getattr(self.filter, name)))

    def step(self, u: Array, y: Array, stages: dict[str, Any] | None = None) -> None:
        """Step in the chip's arithmetic as modelled.

        Parameters
        ----------
        u : ndarray
            Voltages, V, (N, 2).
        y : ndarray
            Currents, A, (N, 2).
        stages : dict, optional
        """
        super().step(self._wrap(tuple(u)), self._wrap(tuple(y)), stages)


def link_chip(folder: GeneratedFolder, kind: str, gain: str, u: Array, y: Array) -> Link:
    """Run both from the drive's start over ``u``, ``y`` (N, 2); judged like link C-D, by the filter's own sigmas.

    Parameters
    ----------
    folder : GeneratedFolder
        The generated folder.
    kind : str
        Filter kind, such as "ickf".
    gain : str
        "cubature" or "jacobian"; matters to the ICKF alone.
    u : ndarray
        Voltages, V, (N, 2).
    y : ndarray
        Currents, A, (N, 2).
    """
    arithmetic = find_target(folder.manifest.get("target", DEFAULT_TARGET)).arithmetic
    model = ChipBackend(
        folder.module, kind, *((arithmetic.number, arithmetic.sin_cos) if arithmetic is not None else (FPU32, None))
    )
    chip = Estimator(folder, kind, model, "float32")
    host = load_folder(folder, kind, "numpy", "float32")
    rows = drift_rows(host, drift(chip, host, u, y), 0)
    return Link("D-chip", "float32 = the chip's modelled arithmetic", folder.drive, kind, gain, f"{len(u)} steps", rows)
