"""The distance of the map's zero level from the true surface, measured at true poses."""
