"""The base of every command: errors in one line, files written whole, processes that end with the command."""
