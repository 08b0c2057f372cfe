"""What scenes are built of: walls, furniture and the primitives they consist of."""
