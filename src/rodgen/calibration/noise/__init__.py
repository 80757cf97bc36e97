"""How much the readings scatter, whatever the model: by replicates, by distances between targets, as stated."""

from rodgen.calibration.noise.noise_floor import NoiseFloor, Replicates, noise_floor, replicates

__all__ = ["NoiseFloor", "Replicates", "noise_floor", "replicates"]
