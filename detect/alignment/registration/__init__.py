"""Tags aligned with the light of their pixels: the model, its sums, the steps and their end."""
