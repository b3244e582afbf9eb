"""Short ways to write a .csg and to read its tree."""

import pytest

import tracers

IDENTITY = "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]"
SYMBOL = {1: "u", 2: "n", 3: "-"}


def parse(text: str, shape: str = "as_written") -> tracers.CsgTree:
    return tracers.parse_csg(text, "m.csg", shape)


def refusal(text: str) -> str:
    with pytest.raises(tracers.ModelError) as caught:
        parse(text)
    message = str(caught.value)
    assert "\n" not in message
    return message


def moved(x: float, y: float, z: float, child: str) -> str:
    matrix = f"[[1, 0, 0, {x}], [0, 1, 0, {y}], [0, 0, 1, {z}], [0, 0, 0, 1]]"
    return f"multmatrix({matrix}) {{ {child} }}"


def torus(x: float, y: float, r: float, angle: float = 360) -> str:
    circle = moved(x, y, 0, f"circle(r = {r});")
    return f"rotate_extrude(angle = {angle}, convexity = 2) {{ {circle} }}"


def infix(tree: tracers.CsgTree) -> str:
    """The tree as a string: leaves as letters in the order of their numbers."""
    stack: list[str] = []
    for op, left, _ in tree.operators:
        if op == 0:
            stack.append("abcdefghijklmnopqrstuvwxyz"[left])
        else:
            right = stack.pop()
            stack.append(f"({stack.pop()}{SYMBOL[op]}{right})")
    return stack.pop()
