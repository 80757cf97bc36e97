"""Watch new readings of a fitted machine for a change."""

from rodgen.calibration.watch.watch import Watch

__all__ = ["Watch"]
