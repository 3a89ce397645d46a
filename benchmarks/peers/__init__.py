"""The motion beside that of other programs, on the same mesh with the same springs.

``python -m benchmarks peers --blender PYTHON --newton PYTHON`` takes interpreters that have ``bpy`` and ``newton``;
without one its rows are left out. You will see a table of the wall time of one simulated second at 24 frames a second
and of the error of the settled shape, and ``--write`` keeps it in ``benchmarks/RESULTS.md``.

The problem is one network of springs and hinges: the bramble's mesh, its first rows clamped, under its own weight, with
the stiffness of a real leaf. A program's settled shape is compared with the network's equilibrium.
"""
