"""Correcting keyframe poses: by a pose graph with loop closures, or by rendering."""
