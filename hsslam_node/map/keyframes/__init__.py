"""Storage of keyframes: rows for ever, pixels in slots, and pixels of staged keyframes."""
