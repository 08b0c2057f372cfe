"""Result files, and the documents made from them."""
