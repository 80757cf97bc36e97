"""Robots as other conventions describe them, and every set of coordinates that brings their end to a pose."""
