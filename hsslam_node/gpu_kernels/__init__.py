"""Fused GPU kernels (Triton): twins of `hsslam_node.kernels` over torch tensors on one CUDA device.

Parameters, layouts and meanings are those of the CPU kernels; what they return, these write into
tensors that the caller gives. No launcher waits for the device, reads from it or allocates, and every
number that changes from one call to the next (pose, step, counts, log beta) is a tensor, so that an
iteration can be captured in a CUDA graph. Sums are made with atomics, so the last bits of a gradient
vary from run to run; `sdf_normal_equations` alone is deterministic.
"""
