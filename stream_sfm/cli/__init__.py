"""The command line: parse, call, print; errors to exit codes. The only place that prints.

A module a command, with `add_parser` and `run`; `main.py` lists them. Not here: anything that a program that imports
the package may want to do.
"""
