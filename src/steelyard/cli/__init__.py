"""The command line: parsing, errors, interruption; the commands are in `commands`."""
