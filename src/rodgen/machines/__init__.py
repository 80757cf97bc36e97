"""Machines: chains of joints with the errors that they really have."""
