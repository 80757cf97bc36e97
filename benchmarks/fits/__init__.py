"""Speed of the fit of a machine, compared with other libraries that fit the same model to the same data."""
