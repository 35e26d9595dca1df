"""Recorded data: its format on disk, and running any of it through a generated filter."""
