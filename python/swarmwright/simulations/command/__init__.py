"""Simulations that are commands: an episode is a process with files, and nothing of it is left afterwards.

`definition` is what an experiment says, `keeper` starts processes and ends them with all that they have
started, `running` runs one to its end, `stepwise` talks with one over its standard input and output, `logs`
reads what they have written. The class that puts it together is `swarmwright.CommandSimulation`.
"""
