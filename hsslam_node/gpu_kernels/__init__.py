"""Fused GPU kernels (Triton): twins of `hsslam_node.kernels` over torch tensors on one CUDA device.

Parameters, layouts and meanings are those of the CPU kernels, but results go to tensors of the caller. No
launcher waits for the device, reads from it or allocates, and every number that changes from one call to the
next (pose, step, counts, log beta) is a tensor, so that a CUDA graph can capture an iteration. Sums use
atomics, so the last bits of a gradient vary from run to run; only `sdf_normal_equations` is deterministic.

Triton compiles a kernel again for sizes that are 1 or divisible by 16, and for pointers that are aligned to
16 bytes. `do_not_specialize` names the sizes that vary from call to call, and
`do_not_specialize_on_alignment` the pointers, so that Triton compiles no kernel during a run.

No argument of a launched kernel is called `params`, `specialization`, `options` or `backend`: Triton 3.7 has
variables of these names in its argument binder and would use those.
"""
