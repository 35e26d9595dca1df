"""A drive in operation, and what goes wrong there: faults injected into the closed loop, and how it recovers."""
