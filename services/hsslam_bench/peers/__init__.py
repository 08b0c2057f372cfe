"""`hsslam-bench peers`: what other systems make of the same sequences, scored by the same code."""
