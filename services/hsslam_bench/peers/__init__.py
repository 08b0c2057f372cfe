"""`hsslam-bench peers`: other systems on the same sequences, scored by the same code."""
