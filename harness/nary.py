"""The n-ary reading of a binary tree, for programs whose operators take many operands.

Operators are the rows (op, left, right) of `tracers.CsgTree.operators`, as a list of lists.
"""

from __future__ import annotations

LEAF, UNION, INTERSECTION, DIFFERENCE = range(4)


def operands(operators: list[list[int]], node: int) -> list[int]:
    """The nodes that the operator at `node` takes at once: ((a ∪ b) ∪ c) is a ∪ b ∪ c, and
    ((a − b) − c) is a − b − c. A chain of any length costs no recursion; what hangs on the right is
    an operand of its own, so that the parts of a model stay together."""
    op, rest = operators[node][0], []
    while operators[node][0] == op:
        _, node, right = operators[node]
        rest.append(right)
    return [node, *reversed(rest)]
