"""What a run leaves, written from its arena: one module for each artefact."""
