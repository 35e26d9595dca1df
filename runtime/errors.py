"""One exception for what the user can mend: its text is one line that says what, where and what would be right."""


class UserError(Exception):
    """Bad input or a missing tool; the command line prints it and exits with 2."""
