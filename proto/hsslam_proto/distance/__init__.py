"""Free space and distances on the wire: messages, arrays, the blocks of a window put together."""
