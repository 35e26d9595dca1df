"""A drive file from facts: what a person knows of a motor, rules with a reason each, and a trial of what they make."""
