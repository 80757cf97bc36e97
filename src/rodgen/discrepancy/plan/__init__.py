"""What to measure next: readings that tell effects apart, show what is not seen yet, or sharpen parameters."""

from rodgen.discrepancy.plan._goals import Gain, Goal
from rodgen.discrepancy.plan._plan import Plan, PlanError, plan, plan_for

__all__ = ["Gain", "Goal", "Plan", "PlanError", "plan", "plan_for"]
