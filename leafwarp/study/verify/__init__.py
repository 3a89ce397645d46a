"""Cases with known answers that prove the numbers on a machine: ``python -m leafwarp verify``.

A case computes something whose answer is known (by theory, an exact solution or a measurement) with the simulation's
own stages and kernels on the device asked for, and compares the two. The references are NumPy and SciPy.
"""
