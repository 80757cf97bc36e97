"""Machines and measurements from other people's files: one module for each kind of file."""
