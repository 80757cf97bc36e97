"""Solve the least-squares problem: where a fit starts, its stages and steps, and rows that it should not believe."""
