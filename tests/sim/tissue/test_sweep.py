"""A sweep loses nothing, repeats nothing, and gives the same table however it was interrupted."""

import concurrent.futures.process
import hashlib
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import distributed
import numpy as np
import pytest

from palpate.sim.tissue import Case, CaseError, Settings, load_strokes, read_table, sobol_cases, sweep
from palpate.sim.tissue.errors import SweepStopped
from palpate.sim.tissue.store import StrokeStore
from tests.docs.blocks import ROOT
from tests.waiting import wait_until

QUICK = Settings(hx_mm=4.0, start_mm=-4.0)

SCRIPT = """
import sys
from palpate.sim.tissue import Settings, sobol_cases, sweep
if __name__ == "__main__":
    sweep(sobol_cases(24, 9), Settings(hx_mm=4.0, start_mm=-4.0), sys.argv[1], workers=2)
"""


def digest(directory):
    return hashlib.sha256((directory / "strokes.parquet").read_bytes()).hexdigest()


def journal_size(directory):
    path = directory / "finished.journal"
    return path.stat().st_size if path.exists() else 0


def group_lives(group):
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def test_a_killed_sweep_goes_on_and_ends_in_the_same_table(tmp_path):
    script = tmp_path / "run.py"
    script.write_text(SCRIPT)
    killed, whole = tmp_path / "killed", tmp_path / "whole"
    child = subprocess.Popen([sys.executable, script, killed], start_new_session=True)
    deadline = time.monotonic() + 120
    while journal_size(killed) < 6000 and time.monotonic() < deadline:
        time.sleep(0.02)
    os.kill(child.pid, signal.SIGKILL)  # the program alone: its workers must go by themselves
    child.wait()
    while group_lives(child.pid) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not group_lives(child.pid)
    with open(killed / "finished.journal", "ab") as journal:
        journal.write(b"STRK\x99\x00")  # as if it had died in the middle of a record
    seen = []
    sweep(sobol_cases(24, 9), QUICK, killed, workers=1, progress=seen.append)
    assert seen[-1].reused > 0
    assert seen[-1].done == seen[-1].total == 24
    sweep(sobol_cases(24, 9), QUICK, whole, executor=ThreadPoolExecutor(1))
    assert digest(killed) == digest(whole)
    assert not (killed / "finished.journal").exists()


def test_an_interrupt_while_the_pool_starts_is_an_interrupt(tmp_path, monkeypatch):
    def interrupted(thread):
        raise KeyboardInterrupt

    before = set(multiprocessing.active_children())
    with monkeypatch.context() as patch:
        patch.setattr(concurrent.futures.process._ExecutorManagerThread, "start", interrupted)
        with pytest.raises(KeyboardInterrupt):
            sweep(sobol_cases(2, 9), QUICK, tmp_path, workers=1)
    assert set(multiprocessing.active_children()) <= before  # no worker is left behind
    assert len(sweep(sobol_cases(2, 9), QUICK, tmp_path, executor=ThreadPoolExecutor(1))) == 2


def test_a_second_sweep_computes_only_what_is_new(tmp_path):
    seen = []
    pool = ThreadPoolExecutor(1)
    sweep(sobol_cases(3, 9), QUICK, tmp_path, executor=pool)
    table = sweep(sobol_cases(5, 9), QUICK, tmp_path, executor=pool, progress=seen.append)
    assert (seen[-1].total, seen[-1].reused) == (5, 3)
    assert len(table) == 5
    before = digest(tmp_path)
    sweep(sobol_cases(5, 9), QUICK, tmp_path, executor=pool, progress=seen.append)
    assert seen[-1].reused == 5
    assert digest(tmp_path) == before


def test_a_flat_probe_is_kept_like_any_other(tmp_path):
    flat = Case(10, 0.8, 10, probe_radius_mm=float("inf"))
    table = sweep([flat], QUICK, tmp_path, executor=ThreadPoolExecutor(1))
    assert list(table.status) == ["ok"]
    assert load_strokes(tmp_path)[0].case == flat


def test_a_case_that_fails_is_recorded_and_the_sweep_goes_on(tmp_path):
    cases = [Case(10, 0.8, 10), Case(10, 0.8, 10, F_rel=100), Case(10, 0.8, 5)]
    table = sweep(cases, QUICK, tmp_path, executor=ThreadPoolExecutor(1))
    assert list(table.status) == ["ok", "failed", "ok"]
    assert "-4.0 mm" in table.reason[1]
    strokes = load_strokes(tmp_path)
    assert [s.case for s in strokes] == [cases[0], cases[2]]
    assert np.isfinite(strokes[0].images_kPa).all()


def test_a_directory_without_a_finished_sweep_says_so(tmp_path):
    with pytest.raises(CaseError, match="no finished sweep"):
        read_table(tmp_path)


def dask_process(kind, *words):
    command = [sys.executable, "-m", f"distributed.cli.dask_{kind}", *words]
    return subprocess.Popen(command, stderr=subprocess.DEVNULL, env={**os.environ, "OMP_NUM_THREADS": "1"})


@contextmanager
def dask_cluster(tmp_path, workers, *options):
    """A scheduler and its workers, each a process: (where they meet, the scheduler, the workers)."""
    meeting_point = tmp_path / "s.json"
    words = ["--no-dashboard", "--scheduler-file", str(meeting_point)]
    scheduler = dask_process("scheduler", "--port", "0", *words)
    workers = [dask_process("worker", "--nthreads", "1", *options, *words) for _ in range(workers)]
    try:
        yield str(meeting_point), scheduler, workers
    finally:
        for process in (*workers, scheduler):
            process.terminate()
        for process in (*workers, scheduler):
            process.wait()


def test_a_dask_cluster_gives_the_same_table_as_a_pool(tmp_path):
    with (
        dask_cluster(tmp_path, 2) as (meeting_point, _, _),
        distributed.Client(scheduler_file=meeting_point, timeout=60) as client,
    ):
        client.wait_for_workers(2, timeout=60)
        sweep(sobol_cases(3, 9), QUICK, tmp_path / "dask", executor=client.get_executor())
    sweep(sobol_cases(3, 9), QUICK, tmp_path / "here", executor=ThreadPoolExecutor(1))
    assert digest(tmp_path / "dask") == digest(tmp_path / "here")


@pytest.mark.long
def test_a_dask_cluster_that_is_killed_is_a_sentence_and_costs_nothing_finished(tmp_path):
    """The scheduler dies as one does: by SIGKILL, in the middle of the sweep."""
    out = tmp_path / "out"
    with (
        dask_cluster(tmp_path, 1) as (meeting_point, scheduler, _),
        distributed.Client(scheduler_file=meeting_point, timeout=60) as client,
    ):
        client.wait_for_workers(1, timeout=60)
        client._timeout = 1  # or it looks for its scheduler for a minute

        def kill(progress):
            if progress.done:
                scheduler.kill()

        with pytest.raises(SweepStopped, match="finished strokes are kept: run it again"):
            sweep(sobol_cases(64, 9), QUICK, out, executor=client.get_executor(), progress=kill)
    seen = []
    sweep(sobol_cases(8, 9), QUICK, out, executor=ThreadPoolExecutor(1), progress=seen.append)
    assert seen[-1].reused > 0 and seen[-1].done == 8


RELAXED_KERNELS = """
import hashlib
import numpy as np
from tests.sim.tissue.blocks import block, tissue_of

tissue = tissue_of(block(np.linspace(-20, 20, 41), np.linspace(-8, 0, 9), shake=0.15), stiffening=2.0)
n, random = len(tissue.mesh.elements), np.random.default_rng(1)
u, q = random.normal(0, 0.02, 2 * len(tissue.mesh.nodes_mm)), random.normal(0, 3.0, (n, 3))
K, frozen = np.zeros((n, 18, 18)), np.zeros((n, 3, 18))
tissue.tangent(u, q, np.arange(n), K, frozen)
p = tissue.pressure(u, q / 100, frozen)
assert np.abs(K).min() > 0 and np.isfinite(K).all() and np.ptp(p) > 0
print(hashlib.sha256(K.tobytes() + frozen.tobytes() + p.tobytes()).hexdigest())
"""
STROKES = """
import hashlib
from palpate.sim.tissue import Settings, simulate, sobol_cases

for case in sobol_cases(2, 9):
    images = simulate(case, Settings(start_mm=-4.0)).images_kPa
    print(hashlib.sha256(images.tobytes()).hexdigest())
"""


@pytest.mark.parametrize(
    "script", [RELAXED_KERNELS, pytest.param(STROKES, marks=pytest.mark.long)], ids=["kernels", "strokes"]
)
def test_the_run_that_compiles_gives_the_bits_of_later_ones(tmp_path, script):
    """Kernels with relaxed arithmetic gave other bits compiled afresh than loaded from the cache."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", script]
    first, second = (subprocess.check_output(command, env=environment, text=True) for _ in range(2))
    assert first == second
    assert next(tmp_path.rglob("kernels.tangent*.nbc"), None) is not None, "it was compiled here"


def test_a_second_design_keeps_what_the_first_had_finished(tmp_path):
    """It deleted the first one's strokes."""
    pool, first, second = ThreadPoolExecutor(1), sobol_cases(3, 9), sobol_cases(2, 10)
    sweep(first, QUICK, tmp_path, executor=pool)
    before = digest(tmp_path)
    assert list(sweep(second, QUICK, tmp_path, executor=pool).code) == [case.code for case in second]
    seen = []
    sweep(first, QUICK, tmp_path, executor=pool, progress=seen.append)
    assert seen[-1].reused == 3 and digest(tmp_path) == before
    sweep([*first, *second], QUICK, tmp_path, executor=pool, progress=seen.append)
    assert seen[-1].reused == 5 and not (tmp_path / "earlier.parquet").exists()


def test_two_sweeps_into_one_directory_are_refused_at_once(tmp_path):
    """The second computed everything, and failed at the end."""

    class Never(ThreadPoolExecutor):
        def submit(self, *_, **__):
            raise AssertionError("something was computed")

    first = StrokeStore(tmp_path)
    with pytest.raises(CaseError, match="another sweep is running into"):
        sweep(sobol_cases(2, 9), QUICK, tmp_path, executor=Never())
    first.close()
    assert len(sweep(sobol_cases(2, 9), QUICK, tmp_path, executor=ThreadPoolExecutor(1))) == 2


class Dying(ThreadPoolExecutor):
    """A cluster that computes two tasks, and then is gone."""

    def __init__(self, how):
        super().__init__(1)
        self.how, self.tasks = how, 0

    def submit(self, work, *args, **kwargs):
        self.tasks += 1
        if self.tasks > 2:
            lost = concurrent.futures.Future()
            lost.cancel() if self.how is None else lost.set_exception(self.how)
            lost.set_running_or_notify_cancel() if self.how is None else None
            return lost
        done = concurrent.futures.Future()
        done.set_result(work(*args, **kwargs))
        return done


@pytest.mark.parametrize(
    "how", [None, distributed.comm.CommClosedError("closed"), concurrent.futures.BrokenExecutor("worker")]
)
def test_a_cluster_that_dies_is_a_sentence_and_costs_nothing_finished(tmp_path, how):
    """It was "unexpected CancelledError"."""
    with pytest.raises(SweepStopped, match="finished strokes are kept: run it again"):
        sweep(sobol_cases(9, 9), QUICK, tmp_path, executor=Dying(how))
    seen = []
    sweep(sobol_cases(9, 9), QUICK, tmp_path, executor=ThreadPoolExecutor(1), progress=seen.append)
    assert seen[-1].reused > 0 and seen[-1].done == 9


def test_ctrl_c_is_heard_by_the_program_and_by_no_worker(tmp_path):
    """In the first seconds of a fresh demo workers complained with tracebacks, 5 of 17 times."""
    script = tmp_path / "run.py"
    # as the command line does, the program says nothing of its own: what is said is a worker's. SciPy would
    # swallow an interrupt that comes while it draws the cases, so those are drawn before
    drawn = "    cases = sobol_cases(4000, 9)\n    print(flush=True)\n    try:\n        sweep(cases"
    quiet = SCRIPT.replace("    sweep(sobol_cases(24, 9)", drawn)
    assert drawn in quiet
    script.write_text(
        quiet.rstrip() + "\n    except BaseException:\n        raise SystemExit(130) from None\n"
    )
    children = []
    for wait_s in (0.2, 0.8, 1.4, 2.5, 4.0):
        child = subprocess.Popen(
            [sys.executable, script, tmp_path / f"s{wait_s}"],
            start_new_session=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        )
        children.append((wait_s, child))
    for _, child in children:
        child.stdout.readline()  # it has its imports behind it
    began = time.monotonic()
    for wait_s, child in children:
        time.sleep(max(0.0, began + wait_s - time.monotonic()))
        os.killpg(child.pid, signal.SIGINT)  # as a terminal does
    for wait_s, child in children:
        _, said = child.communicate(timeout=60)
        assert child.returncode != 0, f"interrupted after {wait_s} s: {said}"
        assert "Traceback" not in said and "Process" not in said, said
        wait_until(lambda: not group_lives(child.pid), "the last of its processes ends")  # noqa: B023


LATE = """
import _multiprocessing
import os
import multiprocessing
from palpate.sim.tissue.workers import pool
if __name__ == "__main__":
    with pool(1, "json"):
        context = multiprocessing.get_context("forkserver")
        lock = context.Lock()
        worker = context.Process(target=print, args=(lock,))
        _multiprocessing.sem_unlink(lock._semlock.name)  # as the program's end does
        worker.start()
        worker.join()
        print(worker.exitcode, flush=True)
        os._exit(0)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="workers are forked on Linux alone")
def test_a_worker_that_starts_as_its_program_ends_says_nothing(tmp_path):
    """One time in five it printed a traceback, for what it was to share had gone."""
    script = tmp_path / "late.py"
    script.write_text(LATE)
    run = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True)
    assert run.stdout == "1\n"
    assert "Traceback" not in run.stderr
