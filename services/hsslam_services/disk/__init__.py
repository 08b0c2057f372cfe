"""File work on the run folder, whose disk may hang."""
