"""The generated C under stress: arbitrary bits (``fuzz``) and hours of drive time (``soak``)."""
