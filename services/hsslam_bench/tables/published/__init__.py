"""Settings that the compared methods have published."""
