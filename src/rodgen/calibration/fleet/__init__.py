"""Many machines: each is diagnosed by itself, and all together show what is common, odd, or changes."""

from rodgen.calibration.fleet.fleet import Fleet
from rodgen.calibration.fleet.pairs import Pair, pairs_of
from rodgen.calibration.fleet.run import diagnose_fleet

__all__ = ["Fleet", "Pair", "diagnose_fleet", "pairs_of"]
