"""PNG, faster than OpenCV reads and writes it."""
