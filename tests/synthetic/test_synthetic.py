"""The synthetic generator: reproducible, with human proportions and joint angles."""

from __future__ import annotations

import re
import subprocess
import sys
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from priorfill.errors import OptionError
from priorfill.synthetic import (
    LABELS,
    MARKER_SEGMENTS,
    MOTIONS,
    Body,
    Noise,
    Style,
    demo,
    synthesise,
)
from priorfill.synthetic.demo import DEMO_GAPS, SECONDS, make_demo_clip
from priorfill.synthetic.gait_curves import RUNNING_PEAKS, SQUAT_KNEE, WALKING_PEAKS
from priorfill.synthetic.generate import INNER_RATE, simulate
from priorfill.synthetic.kinematics import (
    align,
    rot_x,
    rot_y,
    rot_z,
    solve_leg,
)
from priorfill.synthetic.noise import smooth_noise
from priorfill.synthetic.posture import minimum_jerk

STEADY = Style(variability=0.0, drift=0.0)
RIGID = Noise(soft_tissue=0.0, measurement=0.0)
FEET = [i for i, segment in enumerate(MARKER_SEGMENTS) if segment.endswith("foot")]
ON_THE_SPOT = ("reaching", "squatting", "pivoting")


def marker(clip, label):
    return clip.positions[:, LABELS.index(label)]


@cache
def moving(motion, seconds, body, style, seed):
    return simulate(motion, seconds=seconds, body=body, style=style, seed=seed)


def leg_angles(motion, *, seconds=6.0, style=STEADY, body=None, side="l"):
    """Hip flexion (thigh against vertical), knee flexion, ankle dorsiflexion, and the time."""
    segments, inside = moving(motion, seconds, body or Body(), style, 0)
    thigh, shank, foot = (segments[side + name][1][inside] for name in ("thigh", "shank", "foot"))
    heading = np.cross(segments["pelvis"][1][inside][:, :, 1], [0.0, 0.0, 1.0])
    heading /= np.linalg.norm(heading, axis=1, keepdims=True)
    down = -thigh[:, :, 2]
    hip = np.rad2deg(np.arctan2(np.einsum("fi,fi->f", down, heading), -down[:, 2]))
    knee = np.rad2deg(
        np.arccos(np.clip(np.einsum("fi,fi->f", thigh[:, :, 2], shank[:, :, 2]), -1, 1))
    )
    ankle = np.rad2deg(np.arcsin(np.einsum("fi,fi->f", foot[:, :, 0], shank[:, :, 2])))
    return hip, knee, ankle


@cache
def walk():
    return synthesise("walking", seconds=2.0)


def sole(motion, body, style=STEADY, seconds=4.0):
    """Height and horizontal speed of the lower one of heel and ball, both feet."""
    segments, inside = moving(motion, seconds, body, style, 2)
    heights, speeds = [], []
    for side in "lr":
        ankle, foot = segments[f"{side}foot"]
        points = ankle[:, None] + np.einsum("fij,kj->fki", foot, body.skeleton().sole)
        speed = np.linalg.norm(np.gradient(points[..., :2], 1 / INNER_RATE, axis=0), axis=2)
        lower = points[..., 2].argmin(axis=1)
        frames = np.arange(len(points))
        heights.append(points[frames, lower, 2][inside])
        speeds.append(speed[frames, lower][inside])
    return np.array(heights), np.array(speeds)


def turning_points(values, lowest, highest):
    """The local maxima of a cyclic angle between two values."""
    top = (values[1:-1] > values[:-2]) & (values[1:-1] >= values[2:])
    found = values[1:-1][top]
    return found[(found > lowest) & (found < highest)]


# --- clips


@pytest.mark.parametrize("motion", MOTIONS)
def test_clip_says_that_it_is_synthetic(motion):
    clip = synthesise(motion, seconds=1.5, seed=7, body=Body(seed=4))
    assert clip.name == f"synthetic_{motion}_007"
    assert clip.subject == "synthetic-4"
    assert clip.up == "+Z"
    assert clip.labels == LABELS
    assert clip.positions.shape == (180, 41, 3)
    assert not clip.missing.any()
    assert clip.source is None


def test_labels_are_the_41_of_the_marker_set():
    assert len(LABELS) == len(set(LABELS)) == len(MARKER_SEGMENTS) == 41
    left = {label[1:] for label in LABELS if label[0] == "L"}
    right = {label[1:] for label in LABELS if label[0] == "R" and label != "RBAC"}
    assert left == right


@pytest.mark.parametrize("motion", ["walking", "reaching", "mixed"])
def test_same_seed_same_clip(motion):
    first, second, other = (synthesise(motion, seconds=0.5, seed=s) for s in (5, 5, 6))
    assert np.array_equal(first.positions, second.positions)
    assert not np.allclose(first.positions, other.positions, atol=20.0)


def test_a_rate_only_samples_the_same_motion():
    fast = synthesise("walking", seconds=2.0, rate=120.0, noise=Noise(measurement=0.0))
    slow = synthesise("walking", seconds=2.0, rate=30.0, noise=Noise(measurement=0.0))
    np.testing.assert_allclose(slow.positions, fast.positions[::4], atol=1e-9)


def test_a_body_keeps_its_markers_through_its_clips():
    one = synthesise("walking", seconds=1.0, body=Body(seed=3), noise=RIGID)
    two = synthesise("squatting", seconds=1.0, body=Body(seed=3), noise=RIGID, seed=9)
    other = synthesise("walking", seconds=1.0, body=Body(seed=4), noise=RIGID)
    wide = [
        np.linalg.norm(marker(clip, "LFWT") - marker(clip, "RFWT"), axis=1)[0]
        for clip in (one, two, other)
    ]
    assert wide[0] == pytest.approx(wide[1])
    assert abs(wide[0] - wide[2]) > 0.1


def test_import_needs_no_numba():
    code = (
        "import sys, priorfill.synthetic, priorfill.synthetic.demo; "
        "sys.exit('numba' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


# --- the body


@pytest.mark.parametrize(
    ("first", "second", "low", "high"),
    [
        # ranges (mm) for adults; recordings with this marker set are inside
        ("LFWT", "RFWT", 215, 300),
        ("LBWT", "RBWT", 80, 180),
        ("LFWT", "LBWT", 170, 230),
        ("LSHO", "RSHO", 300, 425),
        ("C7", "T10", 160, 335),
        ("CLAV", "STRN", 130, 260),
        ("LFHD", "RFHD", 140, 175),
        ("LKNE", "LANK", 380, 450),
        ("LELB", "LWRA", 250, 305),
        ("LANK", "LTOE", 130, 245),
        ("LHEE", "LTOE", 195, 285),
    ],
)
def test_markers_are_as_far_apart_as_on_people(first, second, low, high):
    clip = walk()
    apart = np.linalg.norm(marker(clip, first) - marker(clip, second), axis=1).mean()
    assert low < apart < high


def test_heights_follow_the_published_proportions():
    body = Body(height=1800.0, placement_sd=0.0)
    clip = synthesise("reaching", seconds=1.0, body=body, style=STEADY, noise=RIGID)
    # Winter 2009, figure 4.1: knee 0.285 H, hip 0.530 H; markers on the joints' outer sides
    assert marker(clip, "LKNE")[:, 2].mean() == pytest.approx(0.285 * 1800.0, rel=0.03)
    assert marker(clip, "LSHO")[:, 2].mean() == pytest.approx(0.83 * 1800.0, rel=0.05)
    skeleton = body.skeleton()
    assert skeleton.thigh == pytest.approx(0.245 * 1800.0)
    assert skeleton.shank == pytest.approx(0.246 * 1800.0)


@pytest.mark.parametrize("motion", MOTIONS)
def test_segments_keep_their_lengths(motion):
    rigid = synthesise(motion, seconds=2.0, noise=RIGID)
    soft = synthesise(motion, seconds=2.0, noise=Noise(measurement=0.0))
    for segment in set(MARKER_SEGMENTS):
        on = [i for i, name in enumerate(MARKER_SEGMENTS) if name == segment]
        if len(on) < 2:
            continue
        for clip, tolerance in ((rigid, 0.02), (soft, 12.0)):
            apart = np.linalg.norm(clip.positions[:, on[0]] - clip.positions[:, on[1]], axis=1)
            assert apart.std() < tolerance


def test_thighs_are_softer_than_the_head():
    rigid = synthesise("running", seconds=3.0, noise=RIGID)
    soft = synthesise("running", seconds=3.0, noise=Noise(measurement=0.0))
    moved = np.linalg.norm(soft.positions - rigid.positions, axis=2).mean(axis=0)
    assert moved[LABELS.index("LTHI")] > 3.0 * moved[LABELS.index("LFHD")]
    assert moved[LABELS.index("LTHI")] > moved[LABELS.index("LSHN")] > moved[LABELS.index("LHEE")]
    assert moved.max() < 20.0


def test_measurement_noise_has_the_size_asked_for():
    still = synthesise("walking", seconds=3.0, noise=Noise(measurement=0.0))
    noisy = synthesise("walking", seconds=3.0, noise=Noise(measurement=0.5))
    assert (noisy.positions - still.positions).std() == pytest.approx(0.5, rel=0.03)


# --- the published angles


def test_walking_reaches_the_published_peaks():
    hip, knee, ankle = leg_angles("walking")
    assert hip.max() == pytest.approx(WALKING_PEAKS["hip_flexion"], abs=4.0)
    assert hip.min() == pytest.approx(WALKING_PEAKS["hip_extension"], abs=3.0)
    assert np.ptp(hip) == pytest.approx(43.0, abs=3.0)  # Kadaba 1990
    assert knee.max() == pytest.approx(WALKING_PEAKS["knee_swing"], abs=3.0)
    stance = turning_points(knee, 14.0, 30.0)
    assert stance.mean() == pytest.approx(WALKING_PEAKS["knee_stance"], abs=3.0)
    assert ankle.max() == pytest.approx(WALKING_PEAKS["ankle_dorsiflexion"], abs=4.0)
    assert ankle.min() == pytest.approx(WALKING_PEAKS["ankle_plantarflexion"], abs=4.0)


def test_running_reaches_the_published_peaks():
    _, knee, _ = leg_angles("running")
    assert knee.max() == pytest.approx(RUNNING_PEAKS["knee_swing"], abs=4.0)
    absorption = turning_points(knee, 35.0, 60.0)
    assert absorption.mean() == pytest.approx(RUNNING_PEAKS["knee_absorption"], abs=4.0)
    propulsion = -turning_points(-knee, -35.0, -16.0)
    assert propulsion.mean() == pytest.approx(RUNNING_PEAKS["knee_propulsion"], abs=6.0)


def test_squats_are_as_deep_as_published():
    hip, knee, ankle = leg_angles("squatting", seconds=8.0)
    assert knee.max() == pytest.approx(SQUAT_KNEE, abs=3.0)
    assert 65.0 < hip.max() < 90.0  # the thighs come about level
    assert 20.0 < ankle.max() < 38.5  # heels down: Hemmerich 2006


def test_the_pelvis_rises_and_falls_twice_a_cycle():
    segments, inside = moving("walking", 6.0, Body(), STEADY, 0)
    height = segments["pelvis"][0][inside, 2]
    assert 15.0 < np.ptp(height) < 60.0  # mm; some 45 in people
    spectrum = np.abs(np.fft.rfft(height - height.mean()))
    hip = leg_angles("walking")[0]
    cycles = np.abs(np.fft.rfft(hip - hip.mean())).argmax()
    assert spectrum.argmax() == pytest.approx(2 * cycles, abs=1)


def test_arms_swing_against_the_legs():
    clip = synthesise("walking", seconds=4.0, style=STEADY, noise=RIGID)
    forward = marker(clip, "LFWT")[0] + marker(clip, "RFWT")[0]
    forward = (forward - marker(clip, "LBWT")[0] - marker(clip, "RBWT")[0]) * [1, 1, 0]
    hands = (marker(clip, "LFIN") - marker(clip, "RFIN")) @ forward
    feet = (marker(clip, "LANK") - marker(clip, "RANK")) @ forward
    assert np.corrcoef(hands, feet)[0, 1] < -0.8


# --- floor contact and speed


@pytest.mark.parametrize("motion", MOTIONS)
def test_feet_stay_above_the_floor(motion):
    clip = synthesise(motion, seconds=5.0, body=Body.random(2), seed=3)
    assert clip.positions[:, FEET, 2].min() > -30.0
    heights, _ = sole(motion, Body(), Style())
    assert heights.min() > -8.0
    if motion != "running":
        assert heights.min(axis=0).max() < 12.0  # one foot is always down


@pytest.mark.parametrize("motion", MOTIONS)
def test_standing_feet_stand_still(motion):
    heights, speeds = sole(motion, Body(), Style())
    slid = speeds[heights < 3.0]
    assert np.median(slid) < (100.0 if motion == "running" else 40.0)  # mm/s


def test_running_has_flights():
    heights, _ = sole("running", Body())
    flying = (heights > 5.0).all(axis=0).mean()
    assert 0.1 < flying < 0.4  # Novacheck 1998: 22 % of the cycle


@pytest.mark.parametrize(
    ("motion", "speed"),
    [("walking", v) for v in (0.7, 1.0, 1.3, 1.6, 2.0)] + [("running", v) for v in (2.4, 3.2, 4.2)],
)
def test_speed_is_the_one_asked_for(motion, speed):
    clip = synthesise(motion, seconds=6.0, style=Style(speed=speed), body=Body.random(5))
    pelvis = clip.positions[:, [LABELS.index(f"{s}WT") for s in ("LF", "RF", "LB", "RB")]].mean(1)
    travelled = np.linalg.norm((pelvis[-1] - pelvis[0])[:2]) / 1000.0
    assert travelled / clip.duration == pytest.approx(speed, rel=0.15)


@pytest.mark.parametrize("seed", [2, 9, 10, 2010])
def test_blended_motions_do_not_leave_a_foot_behind(seed):
    segments, inside = moving("mixed", 7.0, Body(), Style(), seed)
    apart = np.linalg.norm((segments["lfoot"][0] - segments["rfoot"][0])[inside, :2], axis=1)
    assert apart.max() < 0.55 * Body().height  # a long step


@pytest.mark.parametrize("motion", ON_THE_SPOT)
def test_some_motions_stay_where_they_are(motion):
    clip = synthesise(motion, seconds=10.0)
    assert np.ptp(marker(clip, "C7")[:, :2], axis=0).max() < 1200.0


def test_turning_turns_both_ways():
    clip = synthesise("turning", seconds=8.0)
    across = marker(clip, "LFWT") - marker(clip, "RFWT")
    heading = np.rad2deg(np.unwrap(np.arctan2(across[:, 1], across[:, 0])))
    rate = np.gradient(heading, 0.5)[::60]
    assert np.ptp(heading) > 60.0
    assert rate.max() > 0.0 > rate.min()


# --- symmetry


def test_a_symmetric_style_is_symmetric():
    # at 120 steps per minute the right side follows the left by half a second
    style = Style(variability=0.0, drift=0.0, cadence=120.0)
    segments, _ = moving("walking", 3.0, Body(), style, 0)
    half = round(0.5 * INNER_RATE)
    mirror = np.array([1.0, -1.0, 1.0])
    for part in ("thigh", "shank", "foot", "upperarm", "forearm", "hand"):
        left, right = (segments[side + part][1][240:-240, :, 2] for side in "lr")
        np.testing.assert_allclose(left[:-half] * mirror, right[half:], atol=0.01)


def test_asymmetry_moves_the_left_side_more():
    style = Style(variability=0.0, drift=0.0, asymmetry=0.2)
    left, right = (leg_angles("walking", style=style, side=side)[1] for side in "lr")
    assert np.ptp(left) > np.ptp(right) + 4.0


# --- any parameters


@settings(max_examples=20, deadline=None)
@given(
    motion=st.sampled_from(MOTIONS),
    seconds=st.floats(0.01, 4.0),
    rate=st.floats(20.0, 300.0),
    body=st.integers(0, 10_000).map(Body.random),
    style=st.builds(
        Style,
        speed=st.none(),
        amplitude=st.floats(0.3, 1.3),
        arm_swing=st.floats(0.0, 2.0),
        step_width=st.floats(0.0, 250.0),
        toe_out=st.floats(-10.0, 30.0),
        lean=st.floats(-5.0, 20.0),
        asymmetry=st.floats(-0.3, 0.3),
        variability=st.floats(0.0, 3.0),
        drift=st.floats(0.0, 0.1),
        turn_rate=st.floats(-90.0, 90.0),
    ),
    seed=st.integers(0, 2**32),
)
def test_anything_asked_for_is_finite_and_smooth(motion, seconds, rate, body, style, seed):
    clip = synthesise(
        motion, seconds=seconds, rate=rate, body=body, style=style, seed=seed, noise=Noise(1.0, 0.0)
    )
    assert clip.positions.shape == (max(1, round(seconds * rate)), 41, 3)
    assert np.isfinite(clip.positions).all()
    # no marker is faster than a sprinter's foot
    steps = np.linalg.norm(np.diff(clip.positions, axis=0), axis=2) * rate
    assert steps.max(initial=0.0) < 15_000.0
    assert clip.positions[:, FEET, 2].min() > -30.0
    assert clip.positions[:, :, 2].max() < 1.6 * body.height


@settings(max_examples=15, deadline=None)
@given(speed=st.floats(0.6, 2.1), body=st.integers(0, 10_000).map(Body.random))
def test_any_walking_speed_suits_any_body(speed, body):
    synthesise("walking", seconds=0.1, style=Style(speed=speed), body=body)


# --- helper functions


def test_rotations_turn_the_way_they_say():
    quarter = np.array([90.0])
    np.testing.assert_allclose(rot_x(quarter)[0] @ [0, 1, 0], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(rot_y(quarter)[0] @ [0, 0, 1], [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(rot_z(quarter)[0] @ [1, 0, 0], [0, 1, 0], atol=1e-12)


def test_align_takes_one_direction_to_another():
    rng = np.random.default_rng(0)
    start, end = rng.normal(size=(2, 50, 3))
    turned = np.einsum("fij,fj->fi", align(start, end), start)
    cosine = np.einsum("fi,fi->f", turned, end)
    cosine /= np.linalg.norm(start, axis=1) * np.linalg.norm(end, axis=1)
    np.testing.assert_allclose(cosine, 1.0, atol=1e-12)
    np.testing.assert_allclose(align(start, end, 0.0), np.broadcast_to(np.eye(3), (50, 3, 3)))
    np.testing.assert_allclose(
        align(start, start), np.broadcast_to(np.eye(3), (50, 3, 3)), atol=1e-9
    )


def test_a_solved_leg_reaches_its_target():
    skeleton = Body().skeleton()
    rng = np.random.default_rng(1)
    hip = np.zeros((40, 3))
    target = np.array([0.0, 0.0, -700.0]) + rng.uniform(-80, 80, (40, 3))
    thigh = np.broadcast_to(np.eye(3), (40, 3, 3))
    thigh, knee, shank = solve_leg(hip, thigh, target, skeleton)
    ankle = knee + shank @ skeleton.offsets["lfoot"]
    assert np.linalg.norm(ankle - target, axis=1).max() < 1.0  # the rounding of straight legs
    np.testing.assert_allclose(np.linalg.norm(knee, axis=1), skeleton.thigh)


def test_a_leg_too_short_points_at_its_target():
    skeleton = Body().skeleton()
    target = np.array([[300.0, 0.0, -1200.0]])
    _, knee, shank = solve_leg(np.zeros((1, 3)), np.eye(3)[None], target, skeleton)
    ankle = knee + shank @ skeleton.offsets["lfoot"]
    np.testing.assert_allclose(ankle / np.linalg.norm(ankle), target / np.linalg.norm(target))


def test_minimum_jerk_begins_and_ends_at_rest():
    course = minimum_jerk(np.linspace(-0.5, 1.5, 2001))
    assert course[0] == 0.0
    assert course[-1] == 1.0
    assert (np.diff(course) >= 0.0).all()
    assert np.abs(np.gradient(course, 0.001)).max() == pytest.approx(1.875, rel=1e-3)


def test_smooth_noise_has_variance_one():
    noise = smooth_noise((4000, 20), 1.0, 100.0, np.random.default_rng(0))
    assert noise.std() == pytest.approx(1.0, rel=0.1)
    assert np.abs(np.diff(noise, axis=0)).max() < 0.5


# --- invalid arguments


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"motion": "flying"}, "flying"),
        ({"seconds": 0.0}, "length"),
        ({"seconds": -1.0}, "length"),
        ({"seconds": float("nan")}, "length"),
        ({"rate": 0.0}, "rate"),
        ({"seed": -1}, "seed"),
        ({"style": Style(speed=3.0)}, "walking"),
        ({"motion": "running", "style": Style(speed=1.0)}, "running"),
        ({"style": Style(speed=2.0, cadence=70.0)}, "cadence"),
    ],
)
def test_invalid_arguments_are_refused_in_one_line(arguments, message):
    with pytest.raises(OptionError, match=re.escape(message)) as caught:
        synthesise(**({"motion": "walking", "seconds": 1.0} | arguments))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Body(height=100.0),
        lambda: Body(leg=2.0),
        lambda: Body(placement_sd=-1.0),
        lambda: Style(speed=9.0),
        lambda: Style(cadence=10.0),
        lambda: Style(amplitude=float("nan")),
        lambda: Style(asymmetry=1.0),
        lambda: Noise(soft_tissue=-1.0),
        lambda: Noise(measurement=float("inf")),
    ],
)
def test_parameters_out_of_range_are_refused(make):
    with pytest.raises(OptionError, match="give a value from"):
        make()


# --- the demo recording


def test_demo_clip_has_the_gaps_of_its_table():
    truth, gappy = make_demo_clip()
    assert truth.name == gappy.name == "synthetic_demo"
    assert truth.subject.startswith("synthetic-")
    assert not truth.missing.any()
    expected = np.zeros_like(truth.missing)
    table = make_demo_clip.__doc__ or ""
    for start, end, labels in DEMO_GAPS:
        assert re.search(rf"{start:.2f} - {end:.2f} +{' '.join(labels)} ", table)
        columns = [LABELS.index(label) for label in labels]
        expected[round(start * 120) : round(end * 120), columns] = True
    assert np.array_equal(gappy.missing, expected)
    assert np.array_equal(gappy.positions[~expected], truth.positions[~expected])
    assert gappy.missing[-1].any()
    assert not gappy.missing[0].any()
    assert gappy.duration == SECONDS


def test_demo_clip_is_the_same_every_time():
    one = make_demo_clip()[0]
    demo._simulated.cache_clear()
    assert np.array_equal(make_demo_clip()[0].positions, one.positions)
