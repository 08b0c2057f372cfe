"""What messages look like, for other languages and for readers."""
