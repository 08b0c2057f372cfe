"""What a user can ask of a source, a class for each group of options."""
