"""The four rooms as a table of probabilities in NumPy, and what the best policy gets there."""

import numpy as np

# The map of Sutton, Precup & Singh 1999, Figure 2: a cell is a row and a column.
MAP = """\
xxxxxxxxxxxxx
x     x     x
x     x     x
x           x
x     x     x
x     x     x
xx xxxx     x
x     xxx xxx
x     x     x
x     x     x
x           x
x     x     x
xxxxxxxxxxxxx""".splitlines()
CELLS = [(y, x) for y, row in enumerate(MAP) for x, mark in enumerate(row) if mark == " "]
STEPS = ((-1, 0), (0, 1), (1, 0), (0, -1))  # up, right, down, left


def transitions(fail_prob):
    """Return P[a, s, s'], where a step goes astray with a probability, to each other side alike."""
    number = {cell: i for i, cell in enumerate(CELLS)}
    moves = np.zeros((len(STEPS), len(CELLS), len(CELLS)))
    for a, (dy, dx) in enumerate(STEPS):
        for i, (y, x) in enumerate(CELLS):
            moves[a, i, number.get((y + dy, x + dx), i)] = 1.0
    others = moves.sum(0) - moves
    return (1.0 - fail_prob) * moves + fail_prob / 3.0 * others


def values(goal, fail_prob, discount, policy=None, steps=10_000):
    """Return the best value [S] of each cell, or that of a policy [S, A], with 1 at the goal.

    `steps` is how many remain: with few it is what can be got in time.
    """
    here = np.array([cell == tuple(goal) for cell in CELLS])
    value, moves = np.zeros(len(CELLS)), transitions(fail_prob)
    for _ in range(steps):
        of_action = moves @ np.where(here, 1.0, discount * value)  # [A, S]
        new = of_action.max(0) if policy is None else (policy.T * of_action).sum(0)
        new = np.where(here, 0.0, new)
        if np.abs(new - value).max() < 1e-12:
            break
        value = new
    return value
