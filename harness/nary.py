"""The n-ary reading of a binary tree, for programs whose operators take many operands.

Operators are the rows (op, left, right) of `tracers.CsgTree.operators`, as a list of lists.
"""

from __future__ import annotations

LEAF, UNION, INTERSECTION, DIFFERENCE = range(4)


def operands(operators: list[list[int]], node: int) -> list[int]:
    """The nodes that the operator at `node` takes at once: ((a ∪ b) ∪ c) is a ∪ b ∪ c, and
    (a - b) - (c ∪ d) is a - b - c - d. Chains of any length cost no recursion."""
    op = operators[node][0]
    if op != DIFFERENCE:
        return _spread(operators, node, op)
    subtrahends = []
    while operators[node][0] == DIFFERENCE:
        _, node, right = operators[node]
        subtrahends.append(right)
    return [node] + [b for right in reversed(subtrahends) for b in _spread(operators, right, UNION)]


def _spread(operators: list[list[int]], node: int, op: int) -> list[int]:
    """The largest subtrees under `node` that do not begin with `op`, in the order of the source."""
    found, pending = [], [node]
    while pending:
        node = pending.pop()
        if operators[node][0] == op:
            pending += [operators[node][2], operators[node][1]]
        else:
            found.append(node)
    return found
