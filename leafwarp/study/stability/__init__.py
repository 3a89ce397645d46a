"""How far each method holds, measured on this machine: ``python -m leafwarp stability``.

A sweep takes one number (a fluid step, a stiffness, the size of the leaf, ...) over many decades, for each scheme or
method and each precision, through the simulation's own stages. Each point ends as stable, inaccurate or refused;
anything else is a bug.
"""
