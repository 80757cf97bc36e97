"""How fast is a machine fitted to its measurements, beside what else fits the same model to the same numbers?"""
