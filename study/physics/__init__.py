"""A second simulator of machines: parts with their physics, without the formulas of rodgen's catalogue of effects."""
