"""Load levels: the work that is given up when cores are slow or shared, so that poses are in time."""
