"""Trigonometric equations: one in one angle, and pairs of them in two angles."""
