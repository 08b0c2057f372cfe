"""What gives way when cores are slow or shared: levels, who decides, where all can read it."""
