"""How long a diagnosis takes, and how this grows with rows, joints and parameters."""
