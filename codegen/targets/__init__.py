"""The processors that C is generated for, a small description each: see :mod:`codegen.targets.description`."""
