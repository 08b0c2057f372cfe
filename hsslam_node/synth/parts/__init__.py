"""Parts of scenes: walls, furniture and the primitives they consist of."""
