"""Volume rendering and the per-ray losses on the CPU, forward and backward.

Twins: `gpu_kernels/mapping/rendering.py`, `gpu_kernels/mapping/losses.py`.
References: `reference/rendering.py`, `reference/losses.py`.
"""

import numpy as np

from hsslam_node.kernels.compiled import njit

MIDDLE = np.float32(0.4)  # as reference/losses.py
COLOR, DEPTH, SDF_MIDDLE, SDF_TAIL, FREE_SPACE = range(5)  # order of loss weights and terms


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def render_forward(sdf, rgb, inside, z, beta, weights, color, depth, opacity):
    """Render rays from samples sorted near to far (twin of reference/rendering.py).

    sdf, z, inside: [R, S]; rgb: [R, S, 3]. Writes weights [R, S], color [R, 3], depth [R] m and opacity [R].
    """
    rendering_weights(sdf, inside, beta, weights)
    render_sums(rgb, z, weights, color, depth, opacity)


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def rendering_weights(sdf, inside, beta, weights):
    """Weight of each sample of rays from near to far: sdf, inside, weights [R, S]."""
    R, S = sdf.shape
    b, one = np.float32(beta), np.float32(1.0)
    for r in range(R):
        through = one
        for s in range(S):
            w = np.float32(0.0)
            if inside[r, s]:
                kept = np.exp(-b / (one + np.exp(b * sdf[r, s])))
                w = through * (one - kept)
                through *= kept
            weights[r, s] = w


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def render_sums(rgb, z, weights, color, depth, opacity):
    """Weighted sums along the rays; see `render_forward`."""
    R, S = z.shape
    for r in range(R):
        red = green = blue = d = total = np.float32(0.0)
        for s in range(S):
            w = weights[r, s]
            red += w * rgb[r, s, 0]
            green += w * rgb[r, s, 1]
            blue += w * rgb[r, s, 2]
            d += w * z[r, s]
            total += w
        color[r, 0] = red
        color[r, 1] = green
        color[r, 2] = blue
        depth[r] = d
        opacity[r] = total


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def samples_with_color(weights, least, sample):
    """Count the samples whose weight is at least `least`; write their indices to `sample`, ascending.

    All others become grey, which changes a ray's colour by at most S least / 2. They lose their colour
    gradient (the loss gradient times their weight), and the part of their SDF gradient that comes from their
    colour's difference from grey, at most beta least times that difference.
    """
    flat = weights.reshape(weights.size)
    found = 0
    for k in range(flat.size):
        sample[found] = k
        found += flat[k] >= least
    return found


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def losses_backward(
    sdf, rgb, inside, z, beta, weights, color, depth, measured_color, measured_depth, ray_weight,
    loss_weight, truncation_m, free_sdf, d_color_extra, batch_rays, batch_depths, d_sdf, d_rgb,
    ray_loss, terms,
):  # fmt: skip
    """Losses of all rays and their gradients by SDF [R, S] and colour [R, S, 3] of the samples.

    `free_sdf` is that of `free_space_loss`.
    `loss_weight` [5] and `terms` [5] are in the order COLOR, DEPTH, SDF_MIDDLE, SDF_TAIL, FREE_SPACE;
    `ray_weight` [R] scales the depth and SDF terms of a ray (its depth noise), and the colour of a ray
    without depth; `d_color_extra` [R, 3] is the gradient of other losses by the rendered colour. The rays
    are part of a batch of `batch_rays`, `batch_depths` of them with depth: means are over these. `ray_loss`
    [R] becomes the weighted loss of each ray. Returns the gradient by log beta. See `reference/losses.py`.
    """
    R, S = z.shape
    one = np.float32(1.0)
    b = np.float32(beta)
    T = np.float32(truncation_m)
    free = np.float32(free_sdf)
    d_log_beta = 0.0
    per_ray = one / np.float32(batch_rays)
    per_depth = one / np.float32(max(batch_depths, 1))
    terms[:] = 0.0
    d_color = np.empty(3, np.float32)
    for r in range(R):
        D = measured_depth[r]
        loss = np.float32(0.0)
        share = loss_weight[COLOR] if D > 0 else loss_weight[COLOR] * ray_weight[r]
        for c in range(3):
            e = color[r, c] - measured_color[r, c]
            loss += e * e / np.float32(3.0)
            d_color[c] = share * np.float32(2.0 / 3.0) * e * per_ray + d_color_extra[r, c]
        if not D > 0:
            loss *= ray_weight[r]
        terms[COLOR] += loss * per_ray
        loss *= loss_weight[COLOR]
        d_depth = np.float32(0.0)
        scale_middle = scale_tail = scale_free = np.float32(0.0)
        if D > 0:
            e = depth[r] - D
            terms[DEPTH] += e * e * per_depth * ray_weight[r]
            loss += loss_weight[DEPTH] * e * e * ray_weight[r]
            d_depth = loss_weight[DEPTH] * np.float32(2.0) * e * per_depth * ray_weight[r]
            n_middle = n_tail = n_free = 0
            for s in range(S):
                if inside[r, s]:
                    offset = z[r, s] - D
                    if offset < -T:
                        n_free += 1
                    elif abs(offset) < MIDDLE * T:
                        n_middle += 1
                    elif abs(offset) < T:
                        n_tail += 1
            scale_middle = ray_weight[r] / np.float32(max(n_middle, 1))
            scale_tail = ray_weight[r] / np.float32(max(n_tail, 1))
            scale_free = one / np.float32(max(n_free, 1))
        behind = np.float32(0.0)  # sum of w_k g_k over the samples behind
        before = np.float32(1.0)
        for s in range(S):
            before -= weights[r, s]  # ends as the transmittance after the last sample
        for s in range(S - 1, -1, -1):
            d = np.float32(0.0)
            if not inside[r, s]:
                d_sdf[r, s] = d
                d_rgb[r, s, :] = d
                continue
            phi = sdf[r, s]
            w = weights[r, s]
            g = d_depth * z[r, s]
            for c in range(3):
                g += d_color[c] * rgb[r, s, c]
                d_rgb[r, s, c] = w * d_color[c]
            # with after = transmittance behind the sample: dL/dsigma = after * g - sum behind
            sigmoid = one / (one + np.exp(b * phi))
            d_sigma = before * g - behind
            behind += w * g
            before += w
            slope = b * b * sigmoid * (one - sigmoid)  # = -dsigma/dphi
            d -= d_sigma * slope
            d_log_beta += d_sigma * (b * sigmoid - phi * slope)
            if D > 0:
                offset = z[r, s] - D
                if offset < -T:
                    e = phi - free
                    if free < one and e > np.float32(0.0):
                        e = np.float32(0.0)
                    terms[FREE_SPACE] += e * e * scale_free * per_depth
                    loss += loss_weight[FREE_SPACE] * e * e * scale_free
                    d += loss_weight[FREE_SPACE] * np.float32(2.0) * e * scale_free * per_depth
                elif abs(offset) < T:
                    e = phi * T + offset
                    if abs(offset) < MIDDLE * T:
                        terms[SDF_MIDDLE] += e * e * scale_middle * per_depth
                        k = loss_weight[SDF_MIDDLE] * scale_middle
                    else:
                        terms[SDF_TAIL] += e * e * scale_tail * per_depth
                        k = loss_weight[SDF_TAIL] * scale_tail
                    loss += k * e * e
                    d += k * np.float32(2.0) * e * T * per_depth
            d_sdf[r, s] = d
        ray_loss[r] = loss
    return d_log_beta
