"""How processes talk: sessions, topics and requests over zenoh."""
