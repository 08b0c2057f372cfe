"""What the methods of comparison have published beside their numbers."""
