"""Random priors for tests of the energy and its minimisers."""

from priorfill.energy.targets import Prior


def random_prior(rng, frames, markers, scales=(1.0, 1.0, 1.0)):
    """Random targets and weights [shape=(frames, markers)]."""
    targets = [rng.normal(0, 50, (frames, markers, 3)) for _ in range(3)]
    weights = [scale * rng.uniform(0.2, 2, (frames, markers)) for scale in scales]
    return Prior(*targets, *weights, rng.uniform(0, 5, (frames, markers)))
