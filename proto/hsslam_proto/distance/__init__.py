"""Free space and distances on the wire: messages, arrays, assembly of a window from blocks."""
