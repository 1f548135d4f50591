"""Slow but obvious implementations of what priorfill computes fast."""

import numpy as np


def energy(x, missing, poses, velocities, accelerations, weights=None):
    """Eqs. (2)-(4) of Baumann et al. 2011, neighbour by neighbour and frame by frame.

    x (frames, markers, 3); missing (frames, markers); poses, velocities, accelerations
    (frames, k, markers, 3) with velocities and accelerations times the frame step. Differences
    that leave the window have no term.
    """
    frames, k = poses.shape[:2]
    total = 0.0
    for t in range(frames):
        for i in range(k):
            w = 1.0 if weights is None else weights[t, i]
            for m in range(x.shape[1]):
                if not missing[t, m]:
                    continue
                total += w * np.sum((poses[t, i, m] - x[t, m]) ** 2)
                if 0 < t < frames - 1:
                    velocity = (x[t + 1, m] - x[t - 1, m]) / 2
                    acceleration = x[t + 1, m] - 2 * x[t, m] + x[t - 1, m]
                    total += w * np.sum((velocities[t, i, m] - velocity) ** 2)
                    total += w * np.sum((accelerations[t, i, m] - acceleration) ** 2)
    return total


def energy_terms(prior, m, i):
    """Every term of one coordinate of a marker as a row of a least-squares problem."""
    frames = len(prior.pose)
    rows, right = [], []

    def term(weight, coefficients, target):
        row = np.zeros(frames)
        for frame, value in coefficients:
            row[frame] += value
        rows.append(np.sqrt(weight) * row)
        right.append(np.sqrt(weight) * target)

    for t in range(frames):
        term(prior.pose_weight[t, m], [(t, 1)], prior.pose[t, m, i])
        if 0 < t < frames - 1:
            term(
                prior.velocity_weight[t, m],
                [(t + 1, 0.5), (t - 1, -0.5)],
                prior.velocity[t, m, i],
            )
            term(
                prior.acceleration_weight[t, m],
                [(t + 1, 1), (t, -2), (t - 1, 1)],
                prior.acceleration[t, m, i],
            )
    return np.array(rows), np.array(right)


def least_squares_minimum(x, free, prior):
    """Minimise the energy by stacking every term as a row of a least-squares problem."""
    found = x.copy()
    for m in range(x.shape[1]):
        unknown = np.flatnonzero(free[:, m])
        for i in range(3):
            A, b = energy_terms(prior, m, i)
            fixed = np.where(free[:, m], 0.0, np.nan_to_num(x[:, m, i]))
            solution = np.linalg.lstsq(A[:, unknown], b - A @ fixed, rcond=None)[0]
            found[unknown, m, i] = solution
    return found


def scheduled_descent(x, free, prior, options):
    """Descend along conjugate directions, preconditioned by blocks, and count frame updates."""
    found, updates = x.copy(), 0
    frames = len(x)
    for m in range(x.shape[1]):
        terms = [energy_terms(prior, m, i) for i in range(3)]
        matrix = terms[0][0].T @ terms[0][0]
        blocks = [
            np.array(
                [t for t in range(start, min(start + options.block_frames, frames)) if free[t, m]]
            )
            for start in range(0, frames, options.block_frames)
        ]
        blocks = [block for block in blocks if len(block)]

        def slope(y, terms=terms):
            return np.stack([A.T @ (b - A @ y[:, i]) for i, (A, b) in enumerate(terms)], axis=1)

        def height(y, terms=terms, m=m):
            squares = sum(((b - A @ y[:, i]) ** 2).sum() for i, (A, b) in enumerate(terms))
            return squares + prior.constant[:, m].sum()

        def towards(active, gradient, matrix=matrix):
            """Return the moves to the blocks' own minima."""
            move = np.zeros_like(gradient)
            for block in active:
                move[block] = np.linalg.solve(matrix[np.ix_(block, block)], gradient[block])
            return move

        def gain_of(block, gradient, towards=towards):
            """Return the gain of a block at its own minimum; 0 where it hardly moves."""
            move = towards([block], gradient)
            far = np.linalg.norm(move, axis=1).max() > options.min_move
            return (gradient * move).sum() if far else 0.0

        y, everything = found[:, m].copy(), False
        for _ in range(options.max_rounds):
            gains = [gain_of(block, slope(y)) for block in blocks]
            least = 0 if everything else options.min_gain_ratio * max(gains, default=0)
            active = [
                b for b, gain in zip(blocks, gains, strict=True) if gain > 0 and gain >= least
            ]
            if not active:
                break
            worked = np.isin(np.arange(frames), np.concatenate(active))[:, None]
            before, norm, direction = height(y), np.inf, 0.0
            for _ in range(options.max_steps):
                gradient = np.where(worked, slope(y), 0)
                move = towards(active, gradient)
                renewed = (gradient * move).sum()
                direction = move + renewed / norm * direction
                norm = renewed
                last = height(y)
                y = y + norm / (direction * (matrix @ direction)).sum() * direction
                updates += worked.sum()
                if last - height(y) <= options.tolerance * (before - height(y)):
                    break
            enough = before - height(y) > options.tolerance * before
            if everything and not enough:
                break
            everything = not enough
        found[:, m] = y
    return found, updates


def in_root_frames(poses, group, template):
    """Poses [shape=(poses, markers, 3)] by position and heading of a group of each, row by row."""
    shape = template - template.mean(axis=0)
    rows = []
    for pose, points in zip(poses, group, strict=True):
        origin = points.mean(axis=0)
        turned = [complex(*point[:2]) for point in points - origin]
        as_is = [complex(*point[:2]) for point in shape]
        heading = sum(here * there.conjugate() for here, there in zip(turned, as_is, strict=True))
        back = heading.conjugate() / abs(heading) if abs(heading) > 0 else 1.0
        row = []
        for x, y, z in pose - origin:
            flat = complex(x, y) * back
            row += [flat.real, flat.imag, z]
        rows.append(row)
    return np.array(rows)


def nearest(poses, queries, k):
    """Distances and rows of the k nearest poses of each query, by comparing all.

    Both are rounded to single precision first. The squares are summed in the order of the
    dimensions; of equally near poses the first come first.
    """
    poses, queries = (x.astype(np.float32).astype(np.float64) for x in (poses, queries))
    square = np.zeros((len(queries), len(poses)))
    for i in range(poses.shape[1]):
        square += (queries[:, None, i] - poses[None, :, i]) ** 2
    order = np.argsort(square, axis=1, kind="stable")[:, :k]
    return np.sqrt(np.take_along_axis(square, order, axis=1)), order


def left_out_residuals(kernel, targets, blocks):
    """Residuals of a GP when each block is left out, by predicting it from the other rows."""
    residuals = np.empty_like(targets)
    variance = np.empty(len(targets))
    for block in blocks:
        rest = np.setdiff1d(np.arange(len(targets)), block)
        weights = np.linalg.solve(kernel[np.ix_(rest, rest)], kernel[np.ix_(rest, block)])
        residuals[block] = targets[block] - weights.T @ targets[rest]
        covariance = kernel[np.ix_(block, block)] - kernel[np.ix_(block, rest)] @ weights
        variance[block] = np.diag(covariance)
    return residuals, variance


def turned(positions, angle, shift):
    """Positions turned about the vertical (z) and moved."""
    c, s = np.cos(angle), np.sin(angle)
    return positions @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + shift


def half_third_differences(positions):
    """By how far the paths before and after each pair of frames miss each other."""
    frames, markers, _ = positions.shape
    result = np.full((frames - 1, markers, 3), np.nan)
    for m in range(markers):
        for t in range(frames - 1):
            here = positions[t + 1, m] - positions[t, m]
            sides = []
            if t > 0 and not np.isnan(positions[t - 1, m, 0]):
                sides.append(positions[t, m] - positions[t - 1, m])
            if t + 2 < frames and not np.isnan(positions[t + 2, m, 0]):
                sides.append(positions[t + 2, m] - positions[t + 1, m])
            if sides:
                result[t, m] = here - sum(sides) / len(sides)
    return result


def marker_distances(positions, marker, others):
    """Distances of a marker from some others in each frame."""
    return np.array(
        [[np.linalg.norm(pose[other] - pose[marker]) for other in others] for pose in positions]
    )
