"""Filling the trial that is open in Nexus, with a stub that behaves as its documentation says."""

from __future__ import annotations

import csv
import math
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from click.testing import CliRunner, Result
from gappy import AS_ESTIMATED, person, with_gaps
from vicon_stub import ViconNexus, install

import priorfill as pf
from priorfill.cli import main
from priorfill.clip import Clip
from priorfill.database import PriorDatabase
from priorfill.errors import IntegrationError, OptionError
from priorfill.integrations.nexus import NexusTrial, open_nexus
from priorfill.integrations.open_trial import TrialOptions, TrialResult, fill_trial

GAPS = ((60, 75, ("LKNE", "LELB")), (100, 110, ("RTOE",)))


def anna(*gaps: tuple[int, int, tuple[str, ...]]) -> Clip:
    return replace(with_gaps(person(), *(gaps or GAPS)), subject="Anna", name="Walk 01")


def quick(vicon: ViconNexus, **arguments) -> TrialResult:
    """Fill with straight lines, unchecked."""
    arguments = {"method": "linear", "options": AS_ESTIMATED} | arguments
    return fill_trial(NexusTrial(vicon), **arguments)


def same(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether positions are equal to the bit."""
    return one.tobytes() == other.tobytes()


@pytest.fixture
def connected(monkeypatch: pytest.MonkeyPatch) -> ViconNexus:
    """Nexus with a trial of Anna open, as the command line finds it."""
    vicon = ViconNexus([anna()])
    install(monkeypatch, lambda: vicon)
    return vicon


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(main, ["nexus", *map(str, arguments)])


@pytest.mark.windows
def test_only_gaps_of_markers_with_gaps_are_set() -> None:
    clip = anna()
    vicon = ViconNexus([clip])
    done = quick(vicon)
    assert vicon.calls == [("SetTrajectory", "Anna", label) for label in ("LELB", "LKNE", "RTOE")]
    assert sorted(done.set_markers) == ["LELB", "LKNE", "RTOE"]
    after = vicon.clip("Anna", clip)
    assert same(after[~clip.missing], clip.positions[~clip.missing])
    assert not np.isnan(after).any()
    assert same(after, done.result.clip.positions)
    assert done.result.complete


def test_it_is_the_fill_of_the_clip() -> None:
    clip = anna((60, 66, ("LKNE",)))
    vicon = ViconNexus([clip])
    done = fill_trial(NexusTrial(vicon))
    assert same(done.result.clip.positions, pf.fill(clip).clip.positions)
    assert same(vicon.clip("Anna", clip), done.result.clip.positions)


def test_what_stays_missing_does_not_exist() -> None:
    clip = anna((60, 75, ("LKNE",)), (100, 160, ("LKNE",)))
    vicon = ViconNexus([clip])
    done = quick(vicon, gap_filter=pf.GapFilter(max_gap=0.5))
    samples = vicon.data["Anna"]["LKNE"]
    assert samples is not None
    x, _, _, exists = samples
    assert all(exists[60:75])
    assert not any(exists[100:160])
    assert x[100:160] == [0.0] * 60
    assert vicon.blanks == 0  # zeros, as Nexus stores it, not NaN
    assert done.result.complete  # the long gap was not to be filled


def test_nexus_may_round_what_it_stores_to_single_precision() -> None:
    single = person().positions.astype(np.float32).astype(np.float64)
    clip = with_gaps(replace(anna(), positions=single), *GAPS)
    vicon = ViconNexus([clip])
    vicon.stored = lambda value: float(np.float32(value))
    assert len(quick(vicon).set_markers) == 3
    assert same(vicon.clip("Anna", clip)[~clip.missing], clip.positions[~clip.missing])


def test_a_marker_that_was_edited_meanwhile_is_left_alone() -> None:
    clip = anna()
    vicon = ViconNexus([clip])
    reads: list[str] = []

    def edit(subject: str, marker: str) -> None:
        reads.append(marker)
        if marker == "LKNE" and reads.count("LKNE") == 2:  # the user moves a sample a little
            samples = vicon.data["Anna"]["LKNE"]
            assert samples is not None
            samples[0][10] = math.nextafter(samples[0][10], 1e9)

    vicon.before_get = edit
    done = quick(vicon)
    assert done.refused == ("LKNE",)
    assert sorted(done.set_markers) == ["LELB", "RTOE"]
    assert ("SetTrajectory", "Anna", "LKNE") not in vicon.calls
    assert not done.result.complete
    (gap,) = (gap for gap in done.result.gaps if gap.label == "LKNE")
    assert "was changed in Nexus while the trial was filled" in gap.unfilled[0].reason
    assert np.isnan(vicon.clip("Anna", clip)[60:75, clip.labels.index("LKNE")]).all()


def test_a_gap_that_was_filled_meanwhile_is_left_alone() -> None:
    clip = anna()
    vicon = ViconNexus([clip])
    reads: list[str] = []

    def edit(subject: str, marker: str) -> None:
        reads.append(marker)
        if marker == "RTOE" and reads.count("RTOE") == 2:
            samples = vicon.data["Anna"]["RTOE"]
            assert samples is not None
            samples[0][105], samples[3][105] = 12.0, True

    vicon.before_get = edit
    assert quick(vicon).refused == ("RTOE",)
    samples = vicon.data["Anna"]["RTOE"]
    assert samples is not None
    assert samples[0][105] == 12.0


def test_nothing_is_set_in_another_trial() -> None:
    vicon = ViconNexus([anna()])
    trial = NexusTrial(vicon)
    vicon.name = "Walk 02"
    with pytest.raises(
        IntegrationError, match=r"has Walk 02 open .* not Walk 01 .* nothing was set"
    ):
        fill_trial(trial, method="linear", options=AS_ESTIMATED)
    assert vicon.calls == []


def test_a_failure_in_the_middle_states_what_was_set() -> None:
    vicon = ViconNexus([anna()])

    def fail(subject: str, marker: str) -> None:
        if marker == "LKNE":
            raise OSError("the connection was closed")

    vicon.before_set = fail
    with pytest.raises(IntegrationError) as caught:
        quick(vicon)
    assert str(caught.value) == (
        "Walk 01: LKNE could not be set in Nexus (the connection was closed; it is as before); "
        "set before: LELB; not set: LKNE, RTOE; reload the trial without saving it to undo all"
    )
    assert [marker for _, _, marker in vicon.calls] == ["LELB"]


def test_ctrl_c_in_the_middle_states_what_was_set() -> None:
    vicon = ViconNexus([anna()])

    def interrupt(subject: str, marker: str) -> None:
        if marker == "RTOE":
            raise KeyboardInterrupt

    vicon.before_set = interrupt
    with pytest.raises(KeyboardInterrupt, match="set before: LELB, LKNE; not set: RTOE"):
        quick(vicon)


def test_an_error_that_nexus_only_prints_is_found(capsys: pytest.CaptureFixture[str]) -> None:
    vicon = ViconNexus([anna()])
    vicon.before_set = lambda subject, marker: setattr(vicon, "frames", 17)
    with pytest.raises(IntegrationError, match="could not be set in Nexus"):
        quick(vicon)
    assert "invalid argument" in capsys.readouterr().err
    assert vicon.calls == []


def test_a_program_that_changes_measured_samples_is_found_and_undone() -> None:
    clip = anna()
    vicon = ViconNexus([clip])
    original, calls = vicon.SetTrajectory, []

    def shifted(subject, marker, x, y, z, e) -> None:
        calls.append(marker)
        original(subject, marker, [v + (len(calls) == 1) for v in x], y, z, e)

    vicon.SetTrajectory = shifted  # type: ignore[method-assign]
    with pytest.raises(IntegrationError, match="other samples than the filled ones differ"):
        quick(vicon)
    after = vicon.clip("Anna", clip)
    assert same(after[~clip.missing], clip.positions[~clip.missing])
    assert np.isnan(after[clip.missing]).all()


def test_active_subjects_are_filled_each_by_itself() -> None:
    first, second = anna(), replace(anna((20, 30, ("C7",))), subject="Bée O'Neil: 2")
    shifted = second.with_positions(second.positions + np.array([2000.0, 0.0, 0.0]))
    vicon = ViconNexus([first, shifted, replace(anna(), subject="Carl")])
    vicon.active["Carl"] = False
    done = quick(vicon)
    assert [one.clip.subject for one in done.result.subjects] == ["Anna", "Bée O'Neil: 2"]
    assert {subject for _, subject, _ in vicon.calls} == {"Anna", "Bée O'Neil: 2"}
    assert "Bée O'Neil: 2:C7" in done.set_markers
    one = quick(vicon, trial_options=TrialOptions(subject=("Carl",)))
    assert sorted(one.set_markers) == ["LELB", "LKNE", "RTOE"]
    assert {subject for _, subject, _ in vicon.calls[-3:]} == {"Carl"}


def test_subjects_that_are_not_there_or_not_ticked() -> None:
    vicon = ViconNexus([anna()])
    with pytest.raises(OptionError, match="no subject 'Ana'; did you mean Anna"):
        quick(vicon, trial_options=TrialOptions(subject=("Ana",)))
    with pytest.raises(OptionError, match="subject"):
        TrialOptions(subject="Anna")  # type: ignore[arg-type]
    vicon.active["Anna"] = False
    with pytest.raises(IntegrationError, match=r"none of its subjects .* is ticked"):
        quick(vicon)


def test_versions_without_ticks_fill_all_subjects() -> None:
    class Old(ViconNexus):
        GetSubjectInfo = property()  # type: ignore[assignment]

    assert len(quick(Old([anna()])).set_markers) == 3


def test_markers_that_were_not_worn_are_left_out_unless_named() -> None:
    clip = anna(*GAPS, (0, 240, ("C7", "STRN")))
    vicon = ViconNexus([clip])
    vicon.data["Anna"]["STRN"] = None  # never labelled in this trial
    done = quick(vicon)
    assert any("left out: C7, STRN of Anna, not visible in any" in note for note in done.notes)
    assert not {"C7", "STRN"} & set(done.result.clip.labels)
    named = quick(vicon, gap_filter=pf.GapFilter(markers=("c7", "RTOE")))
    assert "C7" in named.result.clip.labels
    assert not named.result.complete  # straight lines have nothing to go by


def test_only_the_region_of_interest_is_filled() -> None:
    vicon = ViconNexus([anna()], first=101, region=(170, 300))  # gaps at 161-175 and 201-210
    done = quick(vicon)
    assert done.result.clip.first_frame == 101
    samples = vicon.data["Anna"]["LKNE"]
    assert samples is not None
    assert not any(samples[3][60:69])
    assert all(samples[3][69:75])
    whole = quick(vicon, trial_options=TrialOptions(whole_trial=True))
    assert whole.result.complete
    assert all(samples[3][75:])
    with pytest.raises(OptionError, match="both `frames` and `whole_trial`"):
        quick(
            vicon,
            trial_options=TrialOptions(whole_trial=True),
            gap_filter=pf.GapFilter(frames=(1, 2)),
        )


@pytest.mark.parametrize(
    ("region", "selected"),
    [((0, 9999), (101, 340)), ((900, 950), (101, 340)), ((0, 150), (101, 150))],
)
def test_a_region_beyond_the_trial(region: tuple[int, int], selected: tuple[int, int]) -> None:
    assert NexusTrial(ViconNexus([anna()], first=101, region=region)).selected == selected


def test_a_range_that_is_a_part_of_the_trial_counts_frames_from_1() -> None:
    vicon = ViconNexus([anna()])
    vicon.range = (20, 200)
    assert NexusTrial(vicon).first_frame == 1
    vicon.range = (20, 400)
    with pytest.raises(IntegrationError, match="240 frames in the range 20-400"):
        NexusTrial(vicon)


def test_lists_of_another_length_are_refused() -> None:
    vicon = ViconNexus([anna()])
    samples = vicon.data["Anna"]["C7"]
    assert samples is not None
    samples[0].pop()
    with pytest.raises(IntegrationError, match=r"returned \[239, 240\] samples of C7 of Anna"):
        quick(vicon)


def test_no_trial_and_no_subject() -> None:
    vicon = ViconNexus([anna()])
    vicon.data = {}
    with pytest.raises(IntegrationError, match="has no subject; label"):
        quick(vicon)
    vicon.name = ""
    with pytest.raises(IntegrationError, match="no trial open"):
        NexusTrial(vicon)


def test_rejected_artefacts_are_replaced_only_on_request() -> None:
    clip = anna((60, 75, ("LKNE",)))
    positions = clip.positions.copy()
    positions[150:152, clip.labels.index("RKNE")] += 400.0  # a spike
    spiky = clip.with_positions(positions)
    kept, replaced = ViconNexus([spiky]), ViconNexus([spiky])
    quick(kept)
    done = quick(replaced, reject_artefacts=True)
    assert done.result.rejected.any()
    k = clip.labels.index("RKNE")
    assert same(kept.clip("Anna", clip)[:, k], positions[:, k])
    assert np.abs(replaced.clip("Anna", clip)[150:152, k] - positions[150:152, k]).min() > 1
    others = ~done.result.filled
    assert same(replaced.clip("Anna", clip)[others], positions[others])


def test_markers_are_not_exchanged(tmp_path: Path) -> None:
    vicon = ViconNexus([anna()])
    before = vicon.clip("Anna", anna()).copy()
    path = tmp_path / "d.toml"
    path.write_text('[[gap]]\nmarker = "LKNE"\nwith = "RKNE"\ndo = "swap"')
    with pytest.raises(OptionError, match="gap 1: swap applies to files; exchange the markers in"):
        quick(vicon, overrides=path)
    assert same(vicon.clip("Anna", anna()), before)


def test_a_database_is_learnt_from(tmp_path: Path) -> None:
    with PriorDatabase.create(tmp_path / "Datenbank ä") as made:
        made.add(person(seconds=6.0, seed=11, body=11))
    clip = anna((0, 240, ("LKNE",)))  # missing throughout: only the database has it
    vicon = ViconNexus([clip])
    done = fill_trial(
        NexusTrial(vicon),
        database=tmp_path / "Datenbank ä",
        gap_filter=pf.GapFilter(markers=("LKNE",)),
    )
    assert done.result.database is not None
    assert done.set_markers == ("LKNE",)
    assert not np.isnan(vicon.clip("Anna", clip)).any()


def test_a_static_trial_of_the_subject_is_learnt_from(tmp_path: Path) -> None:
    static = replace(person(seconds=0.5, seed=4), subject="Anna", name="static")
    pf.write(tmp_path / "static.c3d", static)
    vicon = ViconNexus([anna((0, 240, ("LKNE",)))])
    done = fill_trial(
        NexusTrial(vicon),
        same_subject=[tmp_path / "static.c3d"],
        gap_filter=pf.GapFilter(markers=("LKNE",)),
    )
    assert done.set_markers == ("LKNE",)
    assert any("static" in name for gap in done.result.gaps for name in gap.source_clips)


@pytest.mark.windows
def test_without_the_package_of_nexus(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "viconnexusapi", None)
    with pytest.raises(IntegrationError, match="install it into the Python that runs priorfill"):
        open_nexus()


def test_with_a_package_for_another_python(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "viconnexusapi", ModuleType("viconnexusapi"))

    class Finder:
        def find_spec(self, name, path=None, target=None) -> None:
            if name == "viconnexusapi.ViconNexus":
                raise ImportError("DLL load failed while importing NexusClient3")

    sys.modules["viconnexusapi"].__path__ = []  # type: ignore[attr-defined]
    monkeypatch.setattr(sys, "meta_path", [Finder(), *sys.meta_path])
    with pytest.raises(IntegrationError, match=r"this version of Python \(DLL load failed"):
        open_nexus()


def test_without_nexus(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*host: str) -> None:
        raise OSError("Unable to connect to Nexus")

    install(monkeypatch, refuse)
    with pytest.raises(IntegrationError, match=r"Nexus cannot be reached \(Unable to connect"):
        open_nexus()
    result = run("--host", "lab-pc")
    assert result.exit_code == 1
    assert "start it on lab-pc" in result.stderr


@pytest.mark.windows
def test_the_command_fills_and_prints_the_table(connected: ViconNexus, here: Path) -> None:
    result = run("--method", "linear", "--uncertainty", "errors.csv")
    assert result.exit_code == 0, result.stderr
    assert "LKNE" in result.stdout
    assert "3 of 3 gaps complete; 3 markers set in Nexus, not saved" in result.stdout
    assert [marker for _, _, marker in connected.calls] == ["LELB", "LKNE", "RTOE"]
    with (here / "errors.csv").open(encoding="utf-8", newline="") as file:
        assert len(list(csv.DictReader(file))) == 40
    assert run("--uncertainty", "errors.csv").exit_code == 1  # it exists, and nothing is filled


def test_a_preview_sets_nothing(connected: ViconNexus) -> None:
    result = run("--method", "linear", "--dry-run")
    assert result.exit_code == 0
    assert "nothing was set in Nexus (preview)" in result.stdout
    assert connected.calls == []


def test_exit_status_3_and_the_reason(connected: ViconNexus) -> None:
    reads: list[str] = []

    def edit(subject: str, marker: str) -> None:
        reads.append(marker)
        if marker == "LKNE" and reads.count("LKNE") == 2:
            samples = connected.data["Anna"]["LKNE"]
            assert samples is not None
            samples[2][0] += 1.0

    connected.before_get = edit
    result = run("--method", "linear")
    assert result.exit_code == 3
    assert "2 markers set in Nexus, 1 not set, not saved" in result.stdout
    assert "it was changed in Nexus while the trial was filled" in result.stderr


def test_wrong_usage_and_failures_set_nothing(connected: ViconNexus) -> None:
    for arguments, status, text in (
        (("--method", "linaer"), 2, "did you mean linear"),
        (("--markers", "LKNEE"), 2, "did you mean LKNE"),
        (("--subject", "Ana"), 2, "did you mean Anna"),
        (("--frames", "1-9", "--whole-trial"), 2, "either --frames or --whole-trial"),
        (("--trust-filled",), 2, "--database"),
        (("--database", "nowhere"), 2, "nowhere"),
    ):
        result = run(*arguments)
        assert result.exit_code == status, result.output
        assert text in result.stderr
    assert connected.calls == []


def test_a_trial_without_gaps(monkeypatch: pytest.MonkeyPatch) -> None:
    vicon = ViconNexus([replace(person(), subject="Anna")])
    install(monkeypatch, lambda: vicon)
    result = run()
    assert result.exit_code == 0
    assert "has no gaps to fill; nothing was set in Nexus" in result.stdout
    assert vicon.calls == []


def test_hostile_names_are_printed_harmlessly(monkeypatch: pytest.MonkeyPatch) -> None:
    clip = replace(anna(), subject="A\x1b[31mnna")
    labels = tuple("L\nKNE" if label == "LKNE" else label for label in clip.labels)
    vicon = ViconNexus([replace(clip, labels=labels)])
    vicon.name = "Walk\x1b[2J"
    install(monkeypatch, lambda: vicon)
    result = run("--method", "linear")
    assert result.exit_code == 0
    assert "\x1b" not in result.output
    assert "L\\nKNE" in result.stdout


PAGE = Path(__file__).parents[2] / "docs" / "nexus.md"


def examples() -> list[str]:
    """The Python examples of the page."""
    found = re.findall(r"^( *)```python\n(.*?)^ *```$", PAGE.read_text("utf-8"), re.M | re.S)
    return [re.sub(f"^{indent}", "", text, flags=re.M) for indent, text in found]


@pytest.mark.windows
def test_the_script_of_the_page_hands_on_output_and_status(tmp_path: Path) -> None:
    script = examples()[0]
    started = '[r"C:\\priorfill\\Scripts\\priorfill.exe", "nexus"]'
    assert started in script
    child = "import sys; print('\\u03c3', sys.argv[1:]); sys.exit(3)"
    step = tmp_path / "priorfill_step.py"
    step.write_text(script.replace(started, f"[{sys.executable!r}, '-c', {child!r}]"), "utf-8")
    done = subprocess.run(
        [sys.executable, "-X", "utf8", step, "--database", "D:\\lab priors"],
        capture_output=True,
        stdin=subprocess.DEVNULL,
        check=False,
    )
    assert done.returncode == 3, done.stderr
    assert "\u03c3 ['--database', 'D:\\\\lab priors']" in done.stdout.decode("utf-8")


def test_the_example_in_python_of_the_page(
    connected: ViconNexus, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    PriorDatabase.create(here / "lab-priors").close()
    exec(compile(examples()[1], "nexus.md", "exec"), {})
    assert capsys.readouterr().out == "() ()\n"
    assert connected.calls == []


@pytest.mark.realdata
def test_a_recording_is_filled_as_by_itself(data: Path) -> None:
    recorded = pf.read(data / "gait" / "HC002D06.c3d")
    start = recorded.frames // 2
    clip = with_gaps(recorded, (start, start + 20, recorded.labels[:3]))
    vicon = ViconNexus([clip], first=max(recorded.first_frame, 1))
    done = fill_trial(NexusTrial(vicon), trial_options=TrialOptions(up=clip.up))
    alone = pf.fill(clip)
    assert same(done.result.clip.positions, alone.clip.positions)
    after = vicon.clip(clip.subject, clip)
    assert same(after, alone.clip.positions)
    assert same(after[~clip.missing], clip.positions[~clip.missing])


@pytest.mark.parametrize(
    ("call", "answer"),
    [
        ("GetFrameCount", None),
        ("GetFrameRate", "fast"),
        ("GetTrialName", "Walk 01"),
        ("GetTrialRange", (1,)),
        ("GetTrialRegionOfInterest", ()),
        ("GetSubjectNames", None),
        ("GetSubjectInfo", (["Anna"], ["PlugInGait"])),
        ("GetMarkerNames", None),
        ("GetTrajectory", None),
        ("GetTrajectory", (["a"] * 240,) * 4),
        ("GetTrialName", OSError("connection lost")),
        ("GetTrajectory", RuntimeError("connection lost")),
    ],
)
def test_an_answer_that_is_not_as_documented(call: str, answer: object) -> None:
    """One line, and nothing is set: also where the connection is lost."""
    vicon = ViconNexus([anna()])

    def other(*arguments: object) -> object:
        if isinstance(answer, Exception):
            raise answer
        return answer

    setattr(vicon, call, other)
    with pytest.raises(IntegrationError, match=r"Nexus was asked for .*, and its answer") as caught:
        quick(vicon)
    assert "\n" not in str(caught.value)
    assert vicon.calls == []
