"""The output of a package of files: the version they carry, and the folder they are written to."""
