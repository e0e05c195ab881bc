"""What every part uses: errors, YAML with positions, options, registries of plug-ins, random numbers, texts.

Nothing in here imports another part of Swarmwright, but `typing` and the engine.
"""
