"""Where a store has its keyframes: rows for ever, pixels in slots, and pixels of those that come next."""
