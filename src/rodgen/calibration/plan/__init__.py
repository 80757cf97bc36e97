"""What to measure next: readings that tell effects apart, show what is not seen yet, or sharpen parameters."""

from rodgen.calibration.plan.constraints import Constraints, load_constraints
from rodgen.calibration.plan.goals import Gain, Goal, PlanError
from rodgen.calibration.plan.plan import Plan, plan, plan_for

__all__ = ["Constraints", "Gain", "Goal", "Plan", "PlanError", "load_constraints", "plan", "plan_for"]
