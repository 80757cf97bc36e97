"""What to measure next: readings that tell effects apart, show what is not seen yet, or sharpen parameters."""

from rodgen.calibration.plan.goals import Gain, Goal
from rodgen.calibration.plan.plan import Plan, PlanError, plan, plan_for

__all__ = ["Gain", "Goal", "Plan", "PlanError", "plan", "plan_for"]
