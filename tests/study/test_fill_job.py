"""The fill of a job: outputs and record belong together, whenever it is interrupted."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import pytest

from priorfill import write
from priorfill.filling.fill_file import FileToFill
from priorfill.runtime.atomic_file import temporary_name
from priorfill.study import fill_job as module
from priorfill.study.child.own_memory import _peak_of_status, forget_peak, peak_memory
from priorfill.study.child.run_child import remove_leftovers
from priorfill.study.child.scratch_folder import scratch_folder
from priorfill.study.fill_job import fill_job
from priorfill.study.job import JobLimits, JobOutcome, StudyJob
from priorfill.study.records import file_states, read_record
from priorfill.study.settings import FillSettings
from priorfill.study.settled_jobs import settled_outcome, with_earlier_file
from priorfill.study.study_options import StudyOptions
from priorfill.synthetic.demo import make_demo_clip

LIMITS = JobLimits(seconds=300.0, memory=1 << 40, threads=1)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    clip = make_demo_clip()[1]
    few = [clip.labels.index(label) for label in ("LUPA", "LELB", "LFRM", "LWRA", "RUPA")]
    part = replace(
        clip,
        positions=clip.positions[100:400, few],
        labels=tuple(clip.labels[marker] for marker in few),
    )
    path = tmp_path_factory.mktemp("recording") / "walk.c3d"
    write(path, part)
    return path.read_bytes()


@pytest.fixture
def job(tmp_path: Path, recording: bytes) -> StudyJob:
    (tmp_path / "walk.c3d").write_bytes(recording)
    return StudyJob(
        "walk.c3d",
        str(tmp_path / "walk.c3d"),
        str(tmp_path / "out" / "walk.c3d"),
        str(tmp_path / "out" / ".priorfill" / "walk.c3d.json"),
        FillSettings("linear").to_json(),
        report=str(tmp_path / "out" / "walk.c3d.html"),
        key="k",
    )


def names(job: StudyJob) -> set[str]:
    return {file.name for file in Path(job.output).parent.iterdir()}


def states(job: StudyJob) -> dict[str, str]:
    return {Path(path).name: state for path, state in file_states(read_record(job.record)).items()}


def interrupted(job: StudyJob, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run a job that is interrupted after its record is written."""

    def finish(self: object, waiting: Path) -> None:
        assert waiting.exists()
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(module._NewFile, "finish", finish)
        with pytest.raises(KeyboardInterrupt):
            fill_job(job, LIMITS)


@pytest.mark.windows
def test_a_job_that_is_interrupted_is_done_again_to_the_same_bytes(
    job: StudyJob, monkeypatch: pytest.MonkeyPatch
) -> None:
    interrupted(job, monkeypatch)
    assert names(job) == {".priorfill"}
    written = read_record(job.record).written
    outcome = fill_job(job, LIMITS)
    assert outcome.written == written
    assert states(job) == {"walk.c3d": "written", "walk.c3d.html": "written"}
    assert names(job) == {".priorfill", "walk.c3d", "walk.c3d.html"}

    # with other options, the files of the run before are still there, and known
    other = replace(job, settings=FillSettings("spline").to_json(), key="other")
    interrupted(other, monkeypatch)
    assert "earlier" in states(job).values()
    assert settled_outcome(other, StudyOptions()) is None
    monkeypatch.setattr(FileToFill, "read", raiser(MemoryError()))
    failed = fill_job(other, LIMITS)
    assert failed.replaced == written  # a failure does not forget them
    monkeypatch.undo()
    again = fill_job(other, LIMITS)
    assert (again.status, again.written == written) == (outcome.status, False)


def test_files_of_earlier_runs_stay_known(job: StudyJob) -> None:
    page = fill_job(job, LIMITS).report
    without = replace(job, report=None, key="without")
    outcome = fill_job(without, LIMITS)
    assert settled_outcome(without, StudyOptions()) == outcome
    Path(str(page)).write_text("not of interest now")
    assert settled_outcome(without, StudyOptions()) == outcome
    assert "changed" in settled_outcome(job, StudyOptions()).reason
    Path(str(page)).unlink()
    fill_job(job, LIMITS)
    fill_job(without, LIMITS)
    assert settled_outcome(job, StudyOptions()) is None  # the page may be replaced
    assert fill_job(job, LIMITS).status == outcome.status

    Path(job.source).write_bytes(b"")
    failed = fill_job(job, LIMITS)
    reason = with_earlier_file(failed).reason
    assert reason == f"{failed.reason}; the filled file there is from an earlier run"
    assert settled_outcome(job, StudyOptions()) == failed
    Path(job.output).unlink()
    assert with_earlier_file(failed) == failed


def test_what_somebody_wrote_meanwhile_is_not_replaced(
    job: StudyJob, monkeypatch: pytest.MonkeyPatch
) -> None:
    fill_job(job, LIMITS)
    real = FileToFill.fill

    def fill(self: FileToFill) -> object:
        Path(job.output).write_bytes(b"edited")
        return real(self)

    monkeypatch.setattr(FileToFill, "fill", fill)
    outcome = fill_job(job, LIMITS)
    assert (outcome.status, outcome.try_again) == ("failed", True)
    assert "was changed while writing" in outcome.reason
    assert Path(job.output).read_bytes() == b"edited"
    assert names(job) == {".priorfill", "walk.c3d", "walk.c3d.html"}
    assert "exists already" in fill_job(job, LIMITS).reason
    monkeypatch.undo()
    assert fill_job(replace(job, overwrite=True), LIMITS).status != "failed"


def raiser(error: Exception) -> object:
    def function(*arguments: object, **named: object) -> None:
        raise error

    return function


@pytest.mark.parametrize(
    ("error", "exceeded", "try_again", "reason"),
    [
        (MemoryError(), "memory", True, "needs more than 1099.5 GB of memory; raise the limit"),
        (OSError(errno.ENOMEM, "no memory"), "memory", True, "needs more than"),
        (OSError(errno.ENOSPC, "full", "x"), "", True, "x: full; free some space"),
        (TypeError("a\nbug"), "", False, "output of priorfill fill for this file with PRIORFILL"),
    ],
)
def test_errors_become_one_line(
    job: StudyJob,
    monkeypatch: pytest.MonkeyPatch,
    error: Exception,
    exceeded: str,
    try_again: bool,
    reason: str,
) -> None:
    monkeypatch.setattr(FileToFill, "read", raiser(error))
    outcome = fill_job(job, LIMITS)
    assert (outcome.status, outcome.exceeded) == ("failed", exceeded)
    assert outcome.try_again == try_again
    assert reason in outcome.reason
    assert read_record(job.record) == outcome
    if exceeded:
        assert outcome.peak_memory >= LIMITS.memory


def test_a_bad_file_is_not_tried_again_but_one_that_is_gone_is(job: StudyJob) -> None:
    Path(job.source).write_bytes(b"garbage")
    assert not fill_job(job).try_again
    Path(job.source).unlink()
    outcome = fill_job(job)
    assert outcome.try_again
    assert "there is no such file" in outcome.reason


def test_messages_have_the_names_that_files_get(
    job: StudyJob, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(work: object, result: object, output: Path, files: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", str(output))

    monkeypatch.setattr(module, "write_filled", full)
    outcome = fill_job(job)
    assert outcome.reason == f"{job.output}: No space left on device; free some space"
    assert names(job) == {".priorfill"}


def test_a_record_that_cannot_be_written_is_a_failure(job: StudyJob) -> None:
    record = Path(job.output).parent / "file" / "walk.c3d.json"
    record.parent.parent.mkdir()
    record.parent.write_bytes(b"")
    outcome: JobOutcome = fill_job(replace(job, record=str(record)))
    assert (outcome.status, outcome.try_again) == ("failed", True)
    assert names(job) == {"file"}


def test_the_peak_of_memory_is_without_mapped_files() -> None:
    text = "Name:\tpython\nVmHWM:\t 900 kB\nRssFile:\t 300 kB\nRssShmem:\t 100 kB\nThreads:\t1\n"
    assert _peak_of_status(text) == 500 * 1024
    forget_peak()
    assert peak_memory() > 1 << 20


def test_temporary_files_of_a_child_are_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with scratch_folder(), tempfile.NamedTemporaryFile(delete=False) as file:
        assert Path(file.name).parents[1] == tmp_path
    assert list(tmp_path.iterdir()) == []
    assert tempfile.gettempdir() == str(tmp_path)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "missing"))
    with scratch_folder():
        assert tempfile.gettempdir() == str(tmp_path / "missing")


def test_what_a_killed_process_left_is_removed(
    job: StudyJob, monkeypatch: pytest.MonkeyPatch
) -> None:
    with subprocess.Popen([sys.executable, "-c", ""]) as ended:
        pass
    folder = Path(job.output).parent
    (folder / "mine.part").mkdir(parents=True)
    with monkeypatch.context() as patched:
        patched.setattr(os, "getpid", lambda: ended.pid)
        (folder / temporary_name("")).mkdir()
        (folder / temporary_name(".c3d")).write_bytes(b"")
    running = temporary_name(".c3d")
    (folder / running).write_bytes(b"")
    remove_leftovers(job)
    assert names(job) == {"mine.part", running}
