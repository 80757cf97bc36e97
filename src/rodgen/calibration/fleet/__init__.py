"""Many machines: each is diagnosed by itself, and all together show what is common, odd, or changes."""

from rodgen.calibration.fleet.fleet import Fleet
from rodgen.calibration.fleet.run import Pair, diagnose_fleet, pairs_of

__all__ = ["Fleet", "Pair", "diagnose_fleet", "pairs_of"]
