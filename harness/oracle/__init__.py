"""The certified oracle: what a ray meets in exact arithmetic, and how hits are judged by it.

solid = ExactSolid.from_csg(path, tree)
solid.answer(ray)                                  # Answer: every crossing, the hit, proven
judge_rays(solid, rays, tracer.trace(rays))        # Tally: agree, excused, flip, wrong leaf
"""

from harness.oracle.judge import Verdict, judge
from harness.oracle.solid import Answer, ExactSolid
from harness.oracle.tally import Tally, judge_rays

__all__ = [
    "Answer",
    "ExactSolid",
    "Tally",
    "Verdict",
    "judge",
    "judge_rays",
]
