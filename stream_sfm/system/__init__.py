"""What the operating system gives and takes: files that are read and written, memory, processes, threads and signals;

and the words in which several rooms say what is wrong. Nothing here knows of cameras.
"""
