"""Two saved maps of one place become one: where they meet, one pose graph, one field."""
