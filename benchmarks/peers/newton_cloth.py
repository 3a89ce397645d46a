"""Newton's cloth solvers on the problem of :mod:`benchmarks.peers`: ``PYTHON newton_cloth.py PROBLEM RESULT OPTIONS``.

Runs in an interpreter that has the package ``newton``, and needs nothing of this project.

The membrane is Newton's finite elements with the sheet's Lame constants (springs for XPBD). VBD's hinges hold
``k |e| / 2 (theta - theta0)^2``, so ``k = hinge / |e|``; the other two push the tips along the normals by
``k |e|^2 (theta - theta0)`` with no division by the triangles' heights, so ``k = hinge / (2 area |e|)``.
"""

import json
import sys
import time

import newton
import numpy as np
import warp as wp


def build(problem: dict, solver: str) -> newton.Model:
    """The leaf as a cloth mesh."""
    stiffness, ratio = float(problem["membrane_stiffness"]), 1.0 / 3.0
    edge, hinge = float(problem["edge_length"]), float(problem["hinge"])
    area = np.sqrt(3.0) / 4.0 * edge**2
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, -float(problem["gravity"])))
    builder.add_cloth_mesh(
        pos=wp.vec3(0.0, 0.0, 0.0),
        rot=wp.quat_identity(),
        scale=1.0,
        vel=wp.vec3(0.0, 0.0, 0.0),
        vertices=[wp.vec3(*p) for p in problem["positions"]],
        indices=problem["triangles"].ravel().tolist(),
        density=float(problem["mass_per_area"]),
        tri_ke=0.0 if solver == "xpbd" else stiffness / (2.0 * (1.0 + ratio)),
        tri_ka=0.0 if solver == "xpbd" else stiffness * ratio / (1.0 - ratio**2),
        tri_kd=0.0,
        edge_ke=hinge / edge if solver == "vbd" else hinge / (2.0 * area * edge),
        edge_kd=0.0,
        add_springs=solver == "xpbd",
        spring_ke=float(problem["spring"]),
        spring_kd=0.0,
        particle_radius=1e-4,
    )
    if solver == "vbd":
        builder.color(include_bending=True)
    for vertex in np.flatnonzero(problem["pinned"]):
        builder.particle_mass[vertex] = 0.0
        builder.particle_flags[vertex] &= ~newton.ParticleFlags.ACTIVE
    return builder.finalize(device="cpu")


def make_solver(model: newton.Model, solver: str, iterations: int) -> newton.solvers.SolverBase:
    """One of Newton's solvers."""
    if solver == "semi_implicit":
        # No program looks for contacts; this one would try every triangle with every vertex.
        model.particle_grid = None
        return newton.solvers.SolverSemiImplicit(model, enable_tri_contact=False)
    if solver == "xpbd":
        return newton.solvers.SolverXPBD(model, iterations=iterations)
    return newton.solvers.SolverVBD(model, iterations=iterations)


def main() -> None:
    """Simulate, time the frames after the first, and store the last positions."""
    wp.config.quiet = True
    problem = dict(np.load(sys.argv[1]))
    options = json.loads(sys.argv[3])
    model = build(problem, options["solver"])
    solver = make_solver(model, options["solver"], options.get("iterations", 1))
    substeps = options["substeps"]
    step = 1.0 / (float(problem["fps"]) * substeps)
    now, then = model.state(), model.state()
    control = model.control()
    start = now.particle_q.numpy().copy()

    def two_substeps() -> None:
        for before, after in ((now, then), (then, now)):
            before.clear_forces()
            solver.step(before, after, control, None, step)

    two_substeps()  # compiles the kernels
    with wp.ScopedCapture(device="cpu") as capture:
        two_substeps()
    now.particle_q.assign(start)
    now.particle_qd.zero_()
    begin = time.perf_counter()
    for _ in range(options["frames"] * substeps // 2):
        wp.capture_launch(capture.graph)
    seconds = time.perf_counter() - begin
    positions = now.particle_q.numpy().astype(np.float64)
    np.savez(sys.argv[2], positions=positions, seconds=seconds, version=newton.__version__)


main()
