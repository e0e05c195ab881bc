"""The source of simulations and plug-ins: what a run was computed with, its copy, and what has changed since.

What belongs to it is found without running any of it: the module of the class and all that it imports, except
for modules of Python, of Swarmwright, or of another installed package (of which the record of a run has name
and version). Data files that the code reads do not belong to it.
"""
