"""Measured data: units, tables in files, and measurements as they were written down."""
