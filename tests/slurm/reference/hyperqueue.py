"""What HyperQueue takes for a no-op task, beside `cardiotwin bench orchestration --spawn` (docs/benchmarks.md).

python3 -m venv env && env/bin/pip install hyperqueue==0.27.0 && env/bin/python tests/slurm/reference/hyperqueue.py [TASKS]

Server, worker and client on this machine, every task a process (`true`), submitted as one job. The package has no journal:
what runs twice after kill -9 it cannot tell.
"""

import logging
import os
import sys
import tempfile
import time

from hyperqueue.cluster import LocalCluster, WorkerConfig
from hyperqueue.job import Job

logging.disable(logging.CRITICAL)
n_tasks = int(sys.argv[1]) if len(sys.argv) > 1 else 30_000
cores = os.cpu_count()

with tempfile.TemporaryDirectory() as folder, LocalCluster(folder, WorkerConfig(cores=cores)) as cluster:
    client = cluster.client()
    job = Job(default_workdir=folder)
    for _ in range(n_tasks):
        job.program(["true"], stdout=None, stderr=None)
    began = time.perf_counter()
    submitted = client.submit(job)
    submitted_s = time.perf_counter() - began
    client.wait_for_jobs([submitted])
    run_s = time.perf_counter() - began
    print(f"{n_tasks} tasks on {cores} cores: submit {submitted_s:.2f} s, run {run_s:.2f} s, {1e3 * run_s / n_tasks:.3f} ms a task")
