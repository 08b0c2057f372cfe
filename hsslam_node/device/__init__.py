"""Where the scene model is computed: the choice between CPU and GPU, and what a GPU needs beside kernels."""
