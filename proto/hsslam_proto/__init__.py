"""Everything that crosses a process boundary: topics, messages, codec, schemas of the log."""
