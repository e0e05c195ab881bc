"""Simulations that are commands: an episode is a process with files, which are removed afterwards.

`definition` is the section of an experiment, `keeper` starts processes and ends them with their descendants,
`process` runs a process to its end, `stepwise` communicates with it over its standard input and output, and
`logs` reads its results. `swarmwright.CommandSimulation` combines them.
"""
