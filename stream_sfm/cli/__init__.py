"""The command line: parse, call, print; errors to exit codes."""
