"""What every command stands on: errors in one line, files written whole, processes that end with the command."""
