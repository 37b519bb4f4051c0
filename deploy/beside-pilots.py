#!/usr/bin/env python3
"""Makespan of the same sleeping tasks on four simulated nodes: cardiotwin's jobs, Parsl's pilot and HyperQueue's.

    python3 -m venv ENV && ENV/bin/pip install parsl
    ENV/bin/python deploy/beside-pilots.py [--tasks 1000] [--seconds 2] [--slots 8] [--programs target/release] [--json]

Each starts on an empty one-machine Slurm (deploy/one-machine-slurm.sh) with four nodes of SLOTS cores, and gets whole
nodes for as long as the tasks need. A task is a process that sleeps. HyperQueue is measured where `hq` is on PATH.
Makespan: from the submission to the last result; utilisation: the tasks' time over the slots' time in it.
"""

import argparse
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
NODES = 4

PROFILE = """name = "four-nodes"
description = "four nodes of the one-machine Slurm"
scheduler = "slurm"
[node]
cores = {slots}
memory_mib = {memory}
unit = "node"
[arrays]
allowed = true
[poll]
shortest_s = 1
longest_s = 2
[[queue]]
name = "standard"
partition = "standard"
qos = "standard"
uses = ["simulations", "chunks"]
walltime = "24:00:00"
"""
MEMORY_MIB = 16000


def cardiotwin(options, folder):
    profile = folder / "site.toml"
    profile.write_text(PROFILE.format(slots=options.slots, memory=MEMORY_MIB))
    command = [options.programs / "cardiotwin-dev", "bench", "sleepers", "--json", "--site", profile, "--tasks", options.tasks]
    command += ["--task-s", options.seconds, "--slots", options.slots * NODES]
    answer = subprocess.run([str(word) for word in command], cwd=folder, check=True, capture_output=True, text=True)
    return json.loads(answer.stdout)["makespan_s"]


def parsl(options, folder):
    import parsl
    from parsl.app.app import bash_app
    from parsl.config import Config
    from parsl.executors import HighThroughputExecutor
    from parsl.launchers import SimpleLauncher
    from parsl.providers import SlurmProvider

    programs = Path(sys.executable).parent  # Parsl starts its own programs by name
    os.environ["PATH"] = f"{programs}:{os.environ['PATH']}"
    environment = f"export PATH={programs}:$PATH"
    provider = SlurmProvider(
        partition="standard", qos="standard", nodes_per_block=1, init_blocks=NODES, max_blocks=NODES, min_blocks=NODES,
        exclusive=True, walltime="01:00:00", worker_init=environment, launcher=SimpleLauncher(), cmd_timeout=30,
    )
    executor = HighThroughputExecutor(
        label="pilot", address="127.0.0.1", max_workers_per_node=options.slots, cores_per_worker=1e-6, provider=provider,
        worker_debug=False,
    )

    @bash_app
    def sleep(seconds, number):
        return f"sleep {seconds} # {number}"

    began = time.monotonic()
    with parsl.load(Config(executors=[executor], run_dir=str(folder / "parsl"), strategy="none")):
        futures = [sleep(options.seconds, number) for number in range(options.tasks)]
        assert all(future.result() == 0 for future in futures)
        return time.monotonic() - began


def hyperqueue(options, folder):
    server_dir = ["--server-dir", str(folder / "hq")]
    server = subprocess.Popen(["hq", "server", "start", *server_dir], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        time.sleep(1)
        began = time.monotonic()
        worker = f"hq worker start --cpus {options.slots} --server-dir '{folder / 'hq'}'"
        for _ in range(NODES):
            subprocess.run(["sbatch", "-p", "standard", "--qos=standard", "-N1", "--exclusive", "-t", "60", f"--wrap={worker}"],
                           cwd=folder, check=True, stdout=subprocess.DEVNULL)
        subprocess.run(["hq", "submit", *server_dir, "--array", f"1-{options.tasks}", "--wait", "--stdout=none", "--stderr=none",
                        "sleep", str(options.seconds)], cwd=folder, check=True, stdout=subprocess.DEVNULL)
        return time.monotonic() - began
    finally:
        subprocess.run(["hq", "server", "stop", *server_dir], check=False, stdout=subprocess.DEVNULL)
        server.wait(timeout=30)


def on_a_cluster(measure, options):
    folder = Path(tempfile.mkdtemp(prefix="beside-", dir="/tmp"))
    cluster = folder / "slurm"
    script = [str(HERE / "one-machine-slurm.sh")]
    begin = ["start", str(cluster), "--nodes", str(NODES), "--cpus", str(options.slots), "--memory-mb", str(MEMORY_MIB)]
    try:
        subprocess.run(script + begin, check=True, stdout=subprocess.DEVNULL)
        os.environ["SLURM_CONF"] = str(cluster / "etc/slurm.conf")
        return measure(options, folder)
    finally:
        subprocess.run(script + ["stop", str(cluster)], check=False, stdout=subprocess.DEVNULL)
        shutil.rmtree(folder, ignore_errors=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=2)
    parser.add_argument("--slots", type=int, default=8, help="tasks at once on each node")
    parser.add_argument("--programs", type=Path, default=Path("target/release"))
    parser.add_argument("--only", default="")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    options.programs = options.programs.resolve()
    ideal_s = math.ceil(options.tasks / (options.slots * NODES)) * options.seconds
    found = {"tasks": options.tasks, "task_s": options.seconds, "slots": options.slots * NODES, "ideal_s": ideal_s}
    for name, measure in {"cardiotwin": cardiotwin, "parsl": parsl, "hyperqueue": hyperqueue}.items():
        if options.only and name not in options.only.split(","):
            continue
        try:
            if name == "hyperqueue" and not shutil.which("hq"):
                raise ImportError("no `hq` on PATH")
            makespan_s = on_a_cluster(measure, options)
        except ImportError as error:
            print(f"{name}: not measured ({error})", file=sys.stderr)
            continue
        busy_s = options.tasks * options.seconds / (options.slots * NODES)
        found[name] = {"makespan_s": makespan_s, "utilisation": busy_s / makespan_s}
    if options.json:
        print(json.dumps(found, indent=2))
        return
    print(f"{options.tasks} tasks of {options.seconds:g} s on {NODES} nodes of {options.slots}: {ideal_s:g} s at least")
    for name, row in found.items():
        if isinstance(row, dict):
            print(f"{name:<11} {row['makespan_s']:7.1f} s   {100 * row['utilisation']:3.0f} % of the slots' time")


if __name__ == "__main__":
    main()
