"""How far the map's zero level lies from the true surface, measured at true poses."""
