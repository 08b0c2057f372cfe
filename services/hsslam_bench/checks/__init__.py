"""What is measured, and against which bound."""
