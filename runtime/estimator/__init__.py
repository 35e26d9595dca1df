"""Load a generated filter, then step it or run it over a trajectory. Imports NumPy alone."""

from runtime.estimator.estimator import Estimator, Trace, load

__all__ = ["Estimator", "Trace", "load"]
