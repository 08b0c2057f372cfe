"""Files and archives from the network: resumed where they broke off, checked, put in place at once."""
