"""A solve of diffusion's system that is accurate to rounding whatever the conductances are."""

from __future__ import annotations

import numpy as np


def solve_exchange(exchange: np.ndarray, excess: np.ndarray, right_side: np.ndarray) -> np.ndarray:
    """``y`` of ``excess_i y_i + sum_j exchange_ij (y_i - y_j) = right_side_i``.

    Elimination that carries the row sums along subtracts nothing, so that every content is accurate to some roundings
    however far apart the conductances are (Grassmann, Taksar and Heyman 1985; Alfa, Xue and Ye 2002).

    Args:
        exchange: Between any two cells, symmetric, not negative, with nothing on the diagonal, shape [count, count].
        excess: Sum of each row of the matrix, not negative, shape [count].
        right_side: Not negative, shape [count].
    """
    flow, excess, content = exchange.copy(), excess.copy(), right_side.copy()
    count = len(content)
    pivot = np.empty(count)
    for k in range(count):
        ahead = slice(k + 1, count)
        pivot[k] = excess[k] + flow[k, ahead].sum()
        share = flow[ahead, k] / pivot[k]
        flow[ahead, ahead] += np.outer(share, flow[k, ahead])
        np.fill_diagonal(flow[ahead, ahead], 0.0)
        excess[ahead] += share * excess[k]
        content[ahead] += share * content[k]
    for k in reversed(range(count)):
        content[k] = (content[k] + flow[k, k + 1 :] @ content[k + 1 :]) / pivot[k]
    return content


def step_of_diffusion(
    faces: tuple[np.ndarray, np.ndarray], mask: np.ndarray, water: np.ndarray, split: bool
) -> np.ndarray:
    """The contents after a step of diffusion in exact arithmetic, float64, shape [ny, nx].

    Args:
        faces: Conductance times step over the faces to the right and above, shape [ny, nx].
        mask: Cells that are leaf, shape [ny, nx], bool.
        water: Contents before it, shape [ny, nx].
        split: Rows, then columns; or both at once.
    """
    index = np.full(mask.shape, -1)
    index[mask] = np.arange(mask.sum())
    exchanges = []
    for beta, here, beyond in (
        (faces[0][:, :-1], index[:, :-1], index[:, 1:]),
        (faces[1][:-1], index[:-1], index[1:]),
    ):
        exchange = np.zeros((mask.sum(), mask.sum()))
        joined = beta > 0.0
        exchange[here[joined], beyond[joined]] = exchange[beyond[joined], here[joined]] = beta[joined]
        exchanges.append(exchange)
    content = water[mask]
    for exchange in exchanges if split else [sum(exchanges)]:
        content = solve_exchange(exchange, np.ones(len(content)), content)
    after = np.zeros(mask.shape)
    after[mask] = content
    return after
