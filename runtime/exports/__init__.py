"""Exports: filter, drive and motor of a generated folder for other simulators and for calibration tools."""
