"""The command line: parse, call, print; errors to exit codes. The only place that prints.

One module per command; `main.py` lists them. Not here: anything that a program which imports the package may need.
"""
