"""Drives side by side: what differs in their files and equations, what each costs, how well each does."""
