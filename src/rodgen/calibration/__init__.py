"""What the measurements say about the model."""
