"""The results of a run, written from its arena: one module for each artefact."""
