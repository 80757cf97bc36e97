"""Make up measurements of a machine, with effects that its file does not know."""

from rodgen.calibration.simulate.simulate import Simulation, simulate

__all__ = ["Simulation", "simulate"]
