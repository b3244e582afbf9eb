"""Trees and rays that broke simpler hit rules: what the tests and the stability rows try.

FAMILIES: by name, functions of a numpy Generator that return a `tracers.CsgTree`.
harness.adversaries.aim: rays at whatever is delicate in a tree.
"""

from harness.adversaries.families import FIRST_WAVE, Family
from harness.adversaries.walls import SECOND_WAVE

FAMILIES: dict[str, Family] = FIRST_WAVE | SECOND_WAVE

__all__ = ["FAMILIES", "Family"]
