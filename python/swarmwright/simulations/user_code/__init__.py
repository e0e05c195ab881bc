"""The source of simulations and plug-ins, its copies in runs, and changes since.

The source is found without running it. It consists of the module of the class and all its imports, except for
modules of Python, Swarmwright and other installed packages, whose names and versions the run records. Data
files that the code reads do not belong to it.
"""
