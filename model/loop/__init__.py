"""The loop around the filter: the controller, and the continuous motor it drives."""
