"""A Boolean tree whose leaves are toggled one by one; only what changes is evaluated again."""

from __future__ import annotations

import numpy as np

from harness.nary import INTERSECTION, LEAF, UNION


class BooleanTree:
    """The operators of `tracers.CsgTree.operators`, (nodes, 3), post-order."""

    def __init__(self, operators: np.ndarray) -> None:
        rows = operators.tolist()
        self.operator = [row[0] for row in rows]
        self.left = [row[1] for row in rows]
        self.right = [row[2] for row in rows]
        self.parent = [-1] * len(rows)
        self.node_of_leaf = [-1] * ((len(rows) + 1) // 2)
        for node, (operator, left, right) in enumerate(rows):
            if operator == LEAF:
                self.node_of_leaf[left] = node
            else:
                self.parent[left] = self.parent[right] = node

    def start(self) -> TreeState:
        """All leaves outside; so is the solid, for no operator is true of nothing."""
        return TreeState(self)


class TreeState:
    def __init__(self, tree: BooleanTree) -> None:
        self._tree = tree
        self._value = bytearray(len(tree.parent))

    @property
    def inside(self) -> bool:
        return bool(self._value[-1])

    def leaf(self, leaf: int) -> bool:
        return bool(self._value[self._tree.node_of_leaf[leaf]])

    def toggle(self, leaf: int) -> None:
        tree, value = self._tree, self._value
        operator, left, right, parent = tree.operator, tree.left, tree.right, tree.parent
        node = tree.node_of_leaf[leaf]
        value[node] ^= 1
        while (node := parent[node]) >= 0:
            a, b, op = value[left[node]], value[right[node]], operator[node]
            if op == UNION:
                now = a | b
            elif op == INTERSECTION:
                now = a & b
            else:
                now = a & (b ^ 1)
            if value[node] == now:
                return
            value[node] = now

    def decisive(self, leaves: list[int]) -> tuple[int, ...]:
        """Rule 6 of the hit rule, for leaves (ascending) that have just been toggled together:
        those that alone change the solid, from the state before or the state after; if none does,
        the first that changes it when they are toggled in order. The state stays as it is."""
        if len(leaves) == 1:
            return (leaves[0],)
        alone = {leaf for leaf in leaves if self._changes_with(leaf)}
        for leaf in leaves:
            self.toggle(leaf)
        alone |= {leaf for leaf in leaves if self._changes_with(leaf)}
        in_turn = []
        for leaf in leaves:
            before = self.inside
            self.toggle(leaf)
            if self.inside != before:
                in_turn.append(leaf)
        return tuple(sorted(alone)) or (in_turn[0],)

    def _changes_with(self, leaf: int) -> bool:
        before = self.inside
        self.toggle(leaf)
        changes = self.inside != before
        self.toggle(leaf)
        return changes
