"""Machine files: read, written and edited."""
