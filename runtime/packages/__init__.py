"""Packages: a generated filter with build files and a first program, to drop into a build system."""
