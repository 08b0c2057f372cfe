"""Structural loss over virtual patches on the CPU, with its gradient.

Twin: `gpu_kernels/mapping/patch_ssim.py`. Reference: `reference/losses.py`.
"""

import numpy as np

from hsslam_node.kernels.compiled import njit

_C1 = np.float32(0.01**2)
_C2 = np.float32(0.03**2)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def patch_ssim_backward(color, measured, windows, window_weight, scale, d_color):
    """Returns 1 - mean SSIM; adds `scale` times its gradient to d_color [R, 3].

    color, measured: [R, 3] 0..1; windows [W, k^2] int64 ray indices; window_weight [k^2], sum 1.
    """
    W, K = windows.shape
    if W == 0:
        return 0.0
    total = 0.0
    norm = np.float32(-scale / (3.0 * W))
    two = np.float32(2.0)
    for w in range(W):
        for c in range(3):
            mx = my = xx = yy = xy = np.float32(0.0)
            for k in range(K):
                x = color[windows[w, k], c]
                y = measured[windows[w, k], c]
                g = window_weight[k]
                mx += g * x
                my += g * y
                xx += g * x * x
                yy += g * y * y
                xy += g * x * y
            l_up = two * mx * my + _C1
            l_down = mx * mx + my * my + _C1
            s_up = two * (xy - mx * my) + _C2
            s_down = xx - mx * mx + yy - my * my + _C2
            luminance = l_up / l_down
            structure = s_up / s_down
            total += luminance * structure
            # derivatives of SSIM by mean, second moment and cross moment of the rendered window
            d_xy = luminance * two / s_down
            d_xx = -luminance * structure / s_down
            d_mx = structure * two * (my - luminance * mx) / l_down - my * d_xy - two * mx * d_xx
            for k in range(K):
                ray = windows[w, k]
                g = norm * window_weight[k]
                d_color[ray, c] += g * (d_mx + two * color[ray, c] * d_xx + measured[ray, c] * d_xy)
    return 1.0 - total / (3.0 * W)
