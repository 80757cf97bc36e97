"""Which physical effect is missing in a machine's model, and how far to believe it."""
