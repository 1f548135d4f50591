"""Filling the measurement that is open in QTM, with a stub that behaves as documented."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from click.testing import CliRunner, Result
from gappy import AS_ESTIMATED, person, with_gaps
from qtm_stub import MEASURED_RESIDUAL, Measurement, install, scripting_interface, served

import priorfill as pf
from priorfill.cli import main
from priorfill.clip import Clip
from priorfill.database import PriorDatabase
from priorfill.errors import IntegrationError, OptionError
from priorfill.integrations.open_trial import TrialOptions, TrialResult, fill_trial
from priorfill.integrations.qtm import QtmMeasurement, add_menu, open_qtm
from priorfill.integrations.qtm_rest import RestInterface

GAPS = ((60, 75, ("LKNE", "LELB")), (100, 110, ("RTOE",)))
FEW = ((60, 75, person().labels[:2]),)
LAST = 239


def gappy(*gaps: tuple[int, int, tuple[str, ...]]) -> Clip:
    return with_gaps(person(), *(gaps or GAPS))


def quick(state: Measurement, **arguments) -> TrialResult:
    """Fill with straight lines, unchecked."""
    arguments = {"method": "linear", "options": AS_ESTIMATED} | arguments
    return fill_trial(QtmMeasurement(scripting_interface(state)), **arguments)


def same(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether positions are equal to the bit."""
    return one.tobytes() == other.tobytes()


def run(*arguments: str | int) -> Result:
    return CliRunner().invoke(main, ["qtm", *map(str, arguments)])


@pytest.mark.windows
def test_only_gaps_are_set() -> None:
    clip = gappy()
    state = Measurement(clip)
    done = quick(state)
    assert state.writes == [("LELB", 60, 74), ("LKNE", 60, 74), ("RTOE", 100, 109)]
    after = state.clip(clip)
    assert same(after[~clip.missing], clip.positions[~clip.missing])
    assert same(after, done.result.clip.positions)
    knee = state.find("LKNE")
    assert knee.samples[60]["residual"] == 0.0
    assert knee.samples[59]["residual"] == MEASURED_RESIDUAL
    assert sorted(done.set_markers) == ["LELB", "LKNE", "RTOE"]


def test_it_is_the_fill_of_the_clip() -> None:
    clip = gappy((60, 66, ("LKNE",)))
    state = Measurement(clip)
    fill_trial(QtmMeasurement(scripting_interface(state)))
    assert same(state.clip(clip), pf.fill(clip).clip.positions)


def test_several_gaps_of_a_trajectory_and_what_stays_missing() -> None:
    clip = gappy((0, 5, ("LKNE",)), (60, 75, ("LKNE",)), (100, 160, ("LKNE",)))
    state = Measurement(clip)
    done = quick(state, gap_filter=pf.GapFilter(max_gap=0.5))
    assert state.writes == [("LKNE", 0, 4), ("LKNE", 60, 74)]
    assert not set(range(100, 160)) & set(state.find("LKNE").samples)
    assert done.result.complete


def test_a_trimmed_measurement_keeps_its_indices() -> None:
    clip = gappy()
    state = Measurement(clip, start=500)
    done = quick(state)
    assert state.writes[-1] == ("RTOE", 600, 609)
    assert done.result.clip.first_frame == 501  # numbered from 1, as in exports
    assert same(state.clip(clip), done.result.clip.positions)


def test_only_the_selected_range_is_filled() -> None:
    state = Measurement(gappy(), selected=(70, 239))
    quick(state)
    assert state.writes == [("LELB", 70, 74), ("LKNE", 70, 74), ("RTOE", 100, 109)]
    assert quick(state, trial_options=TrialOptions(whole_trial=True)).result.complete


def test_unidentified_and_discarded_trajectories_are_not_read() -> None:
    clip = gappy()
    state = Measurement(clip)
    state.find("RTOE").discarded = True
    done = quick(state)
    assert "RTOE" not in done.result.clip.labels
    assert {label for label, _, _ in state.writes} == {"LELB", "LKNE"}


def test_a_version_without_discarded_trajectories_and_paths() -> None:
    api = scripting_interface(Measurement(gappy()))
    del api.data.object.trajectory.get_is_discarded, api.file
    trial = QtmMeasurement(api)
    assert trial.name == "measurement"
    assert len(fill_trial(trial, method="linear", options=AS_ESTIMATED).set_markers) == 3


def test_samples_that_qtm_filled_are_noted_and_kept() -> None:
    state = Measurement(gappy())
    state.find("C7").types[30] = "filled"
    assert any("samples of C7 that QTM has filled" in note for note in quick(state).notes)


def test_a_trajectory_that_was_edited_meanwhile_is_left_alone() -> None:
    clip = gappy()
    state = Measurement(clip)
    reads: list[str | None] = []

    def edit(label: str | None) -> None:
        reads.append(label)
        if label == "LKNE" and reads.count("LKNE") == 2:
            state.find("LKNE").samples[10]["position"][2] += 1e-9

    state.before_get = edit
    done = quick(state)
    assert done.refused == ("LKNE",)
    assert {label for label, _, _ in state.writes} == {"LELB", "RTOE"}
    assert not done.result.complete


def test_another_measurement_is_not_touched() -> None:
    state = Measurement(gappy())
    trial = QtmMeasurement(scripting_interface(state))
    state.path = "C:\\other.qtm"
    with pytest.raises(IntegrationError, match=r"another measurement .* than Gång 01"):
        fill_trial(trial, method="linear", options=AS_ESTIMATED)
    assert state.writes == []


def test_a_renamed_trajectory_is_not_touched() -> None:
    state = Measurement(gappy())
    reads: list[str | None] = []

    def edit(label: str | None) -> None:
        reads.append(label)
        if label == "LELB" and reads.count("LELB") == 2:
            state.find("LKNE").label = "RKNE"

    state.before_get = edit
    with pytest.raises(IntegrationError, match="LKNE was renamed or deleted in QTM"):
        quick(state)
    assert {label for label, _, _ in state.writes} == {"LELB"}


def test_a_failure_in_the_middle_is_undone_and_states_what_was_set() -> None:
    clip = gappy((60, 75, ("LELB", "LKNE")), (100, 110, ("LKNE",)))
    state = Measurement(clip)
    calls: list[str | None] = []

    def fail(label: str | None) -> None:
        calls.append(label)
        if calls == ["LELB", "LKNE", "LKNE"]:  # the second gap of the knee
            raise RuntimeError("the file is locked")

    state.before_set = fail
    with pytest.raises(
        IntegrationError,
        match=r"LKNE could not be set in QTM \(the file is locked; it is as before\); set before: "
        "LELB; not set: LKNE",
    ):
        quick(state)
    after = state.clip(clip)
    knee = clip.labels.index("LKNE")
    assert same(
        after[:, knee][~clip.missing[:, knee]], clip.positions[~clip.missing[:, knee], knee]
    )
    assert np.isnan(after[clip.missing[:, knee], knee]).all()


def test_gaps_that_qtm_does_not_list_are_not_set() -> None:
    state = Measurement(gappy())
    api = scripting_interface(state)
    api.data.series._3d.get_gap_ranges = lambda number: []
    with pytest.raises(IntegrationError, match="does not list frame 61 of LELB as a gap"):
        fill_trial(QtmMeasurement(api), method="linear", options=AS_ESTIMATED)
    assert state.writes == []


def test_measured_samples_are_not_replaced_even_if_they_are_artefacts() -> None:
    clip = gappy()
    positions = clip.positions.copy()
    positions[150:152, clip.labels.index("RKNE")] += 400.0
    state = Measurement(clip.with_positions(positions))
    done = quick(state, reject_artefacts=True)
    assert done.result.rejected.any()
    assert {label for label, _, _ in state.writes} == {"LELB", "LKNE", "RTOE"}
    assert not done.result.complete
    assert same(state.clip(clip)[~clip.missing], positions[~clip.missing])


def test_what_cannot_be_told_apart_is_refused() -> None:
    state = Measurement(gappy())
    state.find("C7").label = "T10"
    with pytest.raises(IntegrationError, match="two trajectories are called T10"):
        quick(state)
    with pytest.raises(OptionError, match="QTM has no subjects"):
        quick(Measurement(gappy()), trial_options=TrialOptions(subject=("Anna",)))
    closed = Measurement(gappy())
    closed.trajectories = {}
    with pytest.raises(IntegrationError, match="no measurement open"):
        quick(closed)


def test_a_wrong_number_of_samples_is_refused() -> None:
    api = scripting_interface(Measurement(gappy()))
    api.data.series._3d.get_samples = lambda number, span: []
    with pytest.raises(IntegrationError, match=r"returned 0 samples of .* for 240 frames"):
        fill_trial(QtmMeasurement(api))


def test_a_database_is_learnt_from(tmp_path: Path) -> None:
    with PriorDatabase.create(tmp_path / "db") as made:
        made.add(person(seconds=6.0, seed=11, body=11))
    clip = gappy((0, 240, ("LKNE",)))
    state = Measurement(clip)
    done = fill_trial(
        QtmMeasurement(scripting_interface(state)),
        database=tmp_path / "db",
        gap_filter=pf.GapFilter(markers=("LKNE",)),
    )
    assert done.set_markers == ("LKNE",)
    assert state.writes == [("LKNE", 0, LAST)]


def test_outside_qtm(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "qtm", None)
    with pytest.raises(IntegrationError, match="run this in QTM"):
        open_qtm()
    monkeypatch.setitem(sys.modules, "qtm", ModuleType("qtm"))  # the streaming package
    with pytest.raises(IntegrationError, match="not that of QTM"):
        add_menu()


def press(state: Measurement, command: str) -> None:
    function = state.commands[command]
    assert function is not None
    function()


@pytest.mark.windows
def test_the_menu_fills_and_reports(monkeypatch: pytest.MonkeyPatch) -> None:
    state = Measurement(gappy())
    install(monkeypatch, state)
    add_menu(method="linear")
    add_menu(method="linear")  # F5
    assert [text for _, text, _ in state.buttons] == ["Fill gaps", "Preview (set nothing)"]
    press(state, "priorfill_preview_gaps")
    assert state.writes == []
    assert state.terminal[-1].endswith("nothing was set in QTM (preview)\n")
    press(state, "priorfill_fill_gaps")
    assert len(state.writes) == 3
    text = "".join(state.terminal)
    assert "LKNE    61-75" in text
    assert "3 markers set in QTM, not saved" in state.terminal[-1]
    assert [kind for _, _, kind in state.messages] == ["info", "info"]


def test_the_menu_reports_failures(monkeypatch: pytest.MonkeyPatch) -> None:
    state = Measurement(gappy())
    install(monkeypatch, state)
    add_menu(database="nowhere")
    press(state, "priorfill_fill_gaps")
    assert state.terminal[-1].startswith("priorfill: nowhere")
    assert [kind for _, _, kind in state.messages] == ["error"]
    assert state.writes == []


@pytest.mark.windows
def test_the_command_does_the_same_over_rest() -> None:
    clip = with_gaps(Clip(person().positions[:, :8], person().labels[:8], 60.0), *FEW)
    inside, outside = Measurement(clip), Measurement(clip)
    quick(inside)
    with served(outside) as port:
        trial = QtmMeasurement(RestInterface(port))
        assert trial.name == "Gång 01"
        fill_trial(trial, method="linear", options=AS_ESTIMATED)
        assert outside.writes == inside.writes
        assert same(outside.clip(clip), inside.clip(clip))
        result = run("--port", port, "--method", "linear")
    assert result.exit_code == 0, result.stderr
    assert "has no gaps to fill; nothing was set in QTM" in result.stdout


def test_the_command_warns_of_artefacts_that_it_does_not_replace() -> None:
    clip = gappy((60, 75, ("LKNE",)))
    positions = clip.positions.copy()
    positions[150:152, clip.labels.index("RKNE")] += 400.0
    with served(Measurement(clip.with_positions(positions))) as port:
        result = run("--port", port, "--method", "linear", "--dry-run")
    assert "warning: RKNE" in result.stderr
    assert "delete them in QTM and repeat the fill" in result.stderr
    assert "--reject-artefacts" not in result.stderr


def test_errors_over_rest() -> None:
    state = Measurement(gappy())
    with served(state) as port:
        with pytest.raises(RuntimeError, match=r"_3d.get_samples: RuntimeError: invalid ident"):
            RestInterface(port).data.series._3d.get_samples(1, None)
        with pytest.raises(RuntimeError, match="AttributeError"):
            RestInterface(port).data.nonsense()
    result = run("--port", port)
    assert result.exit_code == 1
    assert f"QTM cannot be reached at port {port}" in result.stderr


@pytest.mark.parametrize("answer", [b"<html>", b"\xff"])
def test_something_else_at_the_port(answer: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    class Answer:
        def __enter__(self) -> Answer:
            return self

        def __exit__(self, *error: object) -> None: ...

        def read(self) -> bytes:
            return answer

    opened: Callable[..., Answer] = lambda request, timeout: Answer()  # noqa: E731
    monkeypatch.setattr("priorfill.integrations.qtm_rest._OPENER.open", opened)
    with pytest.raises(IntegrationError, match="is not QTM"):
        RestInterface().gui.timeline.get_measured_range()


def test_the_script_of_the_page_adds_the_menu(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    page = (Path(__file__).parents[2] / "docs" / "qtm.md").read_text("utf-8")
    (script,) = re.findall(r"^   ```python\n(.*?)^   ```$", page, re.M | re.S)
    state = Measurement(gappy())
    install(monkeypatch, state)
    exec(compile(re.sub("^   ", "", script, flags=re.M), "qtm.md", "exec"), {})
    press(state, "priorfill_preview_gaps")
    assert state.terminal[-1].startswith("priorfill: D:\\lab-priors")  # which is not there


@pytest.mark.realdata
def test_a_recording_is_filled_as_by_itself(data: Path) -> None:
    recorded = pf.read(data / "walkl" / "WalkL.c3d")
    short = Clip(recorded.positions[:400], recorded.labels, recorded.rate, recorded.up)
    clip = with_gaps(short, (150, 180, recorded.labels[:3]))
    state = Measurement(clip)
    done = fill_trial(
        QtmMeasurement(scripting_interface(state)), trial_options=TrialOptions(up=clip.up)
    )
    alone = pf.fill(clip)
    assert same(done.result.clip.positions, alone.clip.positions)
    assert same(state.clip(clip), alone.clip.positions)
    assert same(state.clip(clip)[~clip.missing], clip.positions[~clip.missing])


@pytest.mark.parametrize(
    ("module", "call", "answer"),
    [
        ("timeline", "get_selected_range", None),
        ("timeline", "get_frequency", "fast"),
        ("trajectory", "get_trajectory_ids", None),
        ("trajectory", "get_parts", [{}]),
        ("trajectory", "get_label", RuntimeError("lost")),
        ("series", "get_samples", 3),
        ("series", "get_samples", [{"position": [5.0]}] * 240),
        ("series", "get_samples", [{"position": [1.0, 2.0]}] * 240),
        ("series", "get_samples", [{"position": "up"}] * 240),
    ],
)
def test_an_answer_that_is_not_as_documented(module: str, call: str, answer: object) -> None:
    """One line, and nothing is set: also where one number stands for three."""
    state = Measurement(gappy())
    api = scripting_interface(state)

    def other(*arguments: object) -> object:
        if isinstance(answer, Exception):
            raise answer
        return answer

    places = {
        "timeline": api.gui.timeline,
        "trajectory": api.data.object.trajectory,
        "series": api.data.series._3d,
    }
    setattr(places[module], call, other)
    with pytest.raises(IntegrationError, match=r"QTM was asked for .*, and its answer") as caught:
        fill_trial(QtmMeasurement(api), method="linear", options=AS_ESTIMATED)
    assert "\n" not in str(caught.value)
    assert state.writes == []
