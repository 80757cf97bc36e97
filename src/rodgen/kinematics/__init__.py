"""Numeric kinematics: rotations, screws, the axis of a rotation, and the mechanisms of the four sources."""
