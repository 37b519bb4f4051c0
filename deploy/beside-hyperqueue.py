#!/usr/bin/env python3
"""What a no-op task costs under HyperQueue and under cardiotwin, and which tasks run twice after kill -9.

    python3 -m venv ENV && ENV/bin/pip install hyperqueue==0.27.0
    ENV/bin/python deploy/beside-hyperqueue.py [--tasks 6000] [--cardiotwin target/release/cardiotwin] [--json]

Both start one process for each task, on as many workers as the machine has cores, in folders of their own that are removed again.
PyPI's package is HyperQueue's library with server and workers in one process (LocalCluster); its `hq` program, and with it the
journal that a restarted server reads, is not in it. So kill -9 is dealt to the whole cluster, and the same job is submitted again.
"""

import argparse
import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from pathlib import Path

CHILD = "--as-hyperqueue"
NOTED = "with hq's journal (0.26.2 built from source, noted earlier): killed at about 4,570 of 12,000 tasks, 21 ran twice, none lost"


def as_hyperqueue(folder: Path, tasks: int) -> None:
    """Server, workers and client in this process: tasks that each add a line to a file of their own number."""
    from hyperqueue import Job, LocalCluster
    from hyperqueue.cluster import WorkerConfig

    with LocalCluster(server_dir=str(folder / "server")) as cluster:
        cluster.start_worker(WorkerConfig(cores=os.cpu_count()))
        job = Job(default_workdir=str(folder))
        for n in range(tasks):
            job.program(["/bin/sh", "-c", f"echo {n} >> ran"], name=str(n))
        submitted = cluster.client().submit(job)
        print("submitted", flush=True)
        cluster.client().wait_for_jobs([submitted])


def ran(folder: Path) -> list[int]:
    """Numbers of the tasks that ran, a last line that is not whole left out."""
    file = folder / "ran"
    return [int(line) for line in file.read_text().splitlines()] if file.exists() else []


def start_hyperqueue(folder: Path, tasks: int) -> subprocess.Popen:
    command = [sys.executable, __file__, CHILD, str(folder), str(tasks)]
    log = open(folder / "log", "a")
    return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True)


def finish(process: subprocess.Popen, folder: Path, tasks: int, limit_s: float) -> float:
    """Seconds until every task has run. The client asks once a second, so what the tasks left is looked at instead."""
    began = time.monotonic()
    while len(set(ran(folder))) < tasks:
        if process.poll() not in (None, 0) or time.monotonic() - began > limit_s:
            process.kill()
            sys.exit(f"HyperQueue did not finish within {limit_s:.0f} s:\n{(folder / 'log').read_text()[-2000:]}")
        time.sleep(0.01)
    took = time.monotonic() - began
    process.wait(timeout=60)
    return took


def wait_for_submission(process: subprocess.Popen, folder: Path) -> None:
    began = time.monotonic()
    while "submitted" not in (folder / "log").read_text():
        if process.poll() is not None or time.monotonic() - began > 60:
            sys.exit(f"HyperQueue took no job:\n{(folder / 'log').read_text()[-2000:]}")
        time.sleep(0.005)


def hyperqueue(tasks: int, folder: Path) -> dict:
    calm, killed = folder / "calm", folder / "killed"
    calm.mkdir()
    killed.mkdir()
    process = start_hyperqueue(calm, tasks)
    wait_for_submission(process, calm)
    took = finish(process, calm, tasks, 600)
    process = start_hyperqueue(killed, tasks)
    while len(ran(killed)) < tasks // 2:
        if process.poll() is not None:
            sys.exit(f"HyperQueue ended before half was done:\n{(killed / 'log').read_text()[-2000:]}")
        time.sleep(0.005)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    time.sleep(0.5)  # tasks that were under way end
    before = ran(killed)
    (killed / "log").unlink()
    process = start_hyperqueue(killed, tasks)
    while len(ran(killed)) < len(before) + tasks:
        if process.poll() is not None:
            break
        time.sleep(0.01)
    process.wait(timeout=600)
    every = ran(killed)
    return {
        "ms_per_task": 1e3 * took / tasks,
        "finished_before_kill": len(before),
        "ran_twice": len(every) - len(set(every)),
        "lost": tasks - len(set(every)),
    }


def cardiotwin(program: str, tasks: int, folder: Path) -> dict:
    def bench(name: str, *more: str) -> dict:
        run_dir = folder / name
        command = [program, "bench", "orchestration", "--spawn", "--json", "--patients", str(tasks // 3)]
        answer = subprocess.run([*command, "--run-dir", str(run_dir), *more], check=True, capture_output=True, timeout=900)
        return json.loads(answer.stdout)

    calm, killed = bench("cardiotwin-calm"), bench("cardiotwin-killed", "--kill")
    books = sqlite3.connect(f"file:{folder / 'cardiotwin-killed' / 'cardiotwin.db'}?mode=ro", uri=True)
    ask = lambda sql: books.execute(sql).fetchone()[0]
    closed = (folder / "cardiotwin-killed" / "attempts").rglob("outcome.json")
    outcomes = sum(1 for path in closed if "revoked" not in json.loads(path.read_text()))
    published = ask("SELECT count(*) FROM tasks WHERE word = 'published'")
    return {
        "ms_per_task": calm["ms_per_task"],
        "finished_before_kill": killed["published_before_kill"],
        "ran_twice": outcomes - published,
        "attempts_repeated": ask("SELECT count(*) FROM attempts WHERE generation > 1"),
        "lost": ask("SELECT count(*) FROM tasks") - published,
    }


def bare(tasks: int, folder: Path) -> dict:
    """The same processes with nobody who keeps books."""
    numbers = "\n".join(map(str, range(tasks)))
    command = ["xargs", f"-P{os.cpu_count()}", "-I{}", "/bin/sh", "-c", "echo {} >> ran"]
    began = time.monotonic()
    subprocess.run(command, input=numbers, text=True, check=True, cwd=folder)
    return {"ms_per_task": 1e3 * (time.monotonic() - began) / tasks}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", type=int, default=6000)
    parser.add_argument("--cardiotwin", default="target/release/cardiotwin-dev")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="beside-"))
    try:
        found = {"tasks": options.tasks, "xargs": bare(options.tasks, folder)}
        found["cardiotwin"] = cardiotwin(options.cardiotwin, options.tasks, folder)
        try:
            import hyperqueue as package  # noqa: F401

            found["hyperqueue"] = hyperqueue(options.tasks, folder)
        except ImportError as error:
            found["hyperqueue"] = None
            print(f"no HyperQueue here ({error}): pip install hyperqueue==0.27.0", file=sys.stderr)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    found["noted"] = NOTED
    if options.json:
        print(json.dumps(found, indent=2))
        return
    print(f"{options.tasks} tasks, a process each, {os.cpu_count()} at once")
    for name in ("xargs", "hyperqueue", "cardiotwin"):
        if found[name]:
            figures = ", ".join(f"{key} {value:.3g}" if isinstance(value, float) else f"{key} {value}" for key, value in found[name].items())
            print(f"{name:<11} {figures}")
    print(NOTED)


if __name__ == "__main__":
    if CHILD in sys.argv:
        as_hyperqueue(Path(sys.argv[2]), int(sys.argv[3]))
    else:
        main()
