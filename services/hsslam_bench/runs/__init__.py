"""A run that is made to be measured, and what it leaves."""
