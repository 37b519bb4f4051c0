#!/usr/bin/env python3
"""How long a beat takes on many ranks: a model from figures of one, and what was measured beside it.

    deploy/scaling-model.py ONE.json [MEASURED.json …]

ONE.json is what `cardiotwin-dev bench beat --nodes N --threads 1 --json` printed, or --threads 2, whose processor time then stands for
one rank's time. With --threads 1,2,… the beats that follow the first one are measured, too; each MEASURED.json is a beat of the same
mesh on more ranks, as deploy/scaling.sbatch leaves them. Constants of the machine are options. Plain Python 3, nothing to install.

A beat of E elements and N nodes on R ranks of nodes with C cores:

    elements    (seconds of ONE less its Krylov iterations) · overlap / R,  overlap = 1 + 0.145 (1000 R / N)^(1/3)
    matrix      bytes of an iteration · overlap / R over the smaller of a core's rate in ONE and its share of the node's bandwidth;
                the second only where a rank's share of the matrix does not fit its share of the cache
    halos       2.4 an iteration, 37 bytes a ghost together: latency, neighbours · overhead, bytes over the link
    reductions  4.5 an iteration: ⌈log₂ R⌉ rounds of the latency; one carries 48 bytes for each large group of nodes
    levels      every 64 Newton iterations rank 0 inverts the stiffness of the G large groups, 2 (6 G)³ operations, and sends
                it to all: (6 G)² numbers over the link, ⌈log₂ R⌉ times. G is the first power of two above N / 625 (500 nodes a
                group at least), or R where that is more, since groups end at the border of a rank
"""

import argparse
import json
import math


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("one", help="JSON of a beat on one rank")
    parser.add_argument("measured", nargs="*", help="JSON of beats on more ranks")
    parser.add_argument("--ranks", default="16,64,128,512", help="ranks to predict")
    parser.add_argument("--cores", type=int, default=128, help="cores of a node")
    parser.add_argument("--node-gb-per-s", type=float, default=330.0, help="triad of a whole node")
    parser.add_argument("--core-speed", type=float, default=1.0, help="a core's speed over that of the machine of ONE")
    parser.add_argument("--cache-mb", type=float, default=4.0, help="last-level cache of a core")
    parser.add_argument("--near-us", type=float, default=0.8, help="latency within a node")
    parser.add_argument("--far-us", type=float, default=2.0, help="latency between nodes")
    parser.add_argument("--overhead-us", type=float, default=0.4, help="cost of a message to its sender")
    parser.add_argument("--gigaflops", type=float, default=10.0, help="rank 0's speed at the inverse of the large groups")
    parser.add_argument("--link-gb-per-s", type=float, default=2.0, help="bandwidth of a rank's messages")
    return parser.parse_args()


def overlap(ranks, nodes):
    """Elements of the fullest rank over an equal share: 1.145 for 1,000 nodes a rank, as measured on 8 ranks."""
    return 1.0 if ranks == 1 else 1.0 + 0.145 * (1000.0 * ranks / nodes) ** (1 / 3)


def neighbours(ranks):
    """A wall one or two parts thick: 1, 3 and 6 were measured on 2, 4 and 8 ranks."""
    return {1: 0, 2: 1, 4: 3}.get(ranks, min(ranks - 1, 8))


def groups(ranks, nodes):
    """Large groups of the levels of rigid motions, halved until none has more than a 128th of the nodes and a quarter."""
    largest = max(5 * nodes / (4 * 128), 500)
    own = 2 ** max(0, math.ceil(math.log2(nodes / ranks / largest)))
    return own * ranks


def predict(one, ranks, m):
    iterations = one["krylov_iterations"]
    own = one["ms_per_krylov_iteration"] * 1e-3 * one["threads"]
    rest = max(one["processor_seconds_total"] - iterations * own, 0.0)
    more = overlap(ranks, one["nodes"])
    elements = rest / m.core_speed * more / ranks
    share = one["MB_per_krylov_iteration"] * 1e6 * more / ranks
    by_core = share / (one["MB_per_krylov_iteration"] * 1e6 / own * m.core_speed)
    on_node = min(ranks, m.cores)
    by_node = share * on_node / (m.node_gb_per_s * 1e9) if share > m.cache_mb * 1e6 else 0.0
    latency = (m.near_us if ranks <= m.cores else m.far_us) * 1e-6
    # Ghosts of a rank: 300 of 1,000 nodes a rank, as an area.
    ghosts = 0.0 if ranks == 1 else 300.0 * (one["nodes"] / ranks / 1000.0) ** (2 / 3)
    link = m.link_gb_per_s * 1e9
    halo = 2.4 * (latency + neighbours(ranks) * m.overhead_us * 1e-6 + 37 * ghosts / link)
    rounds = math.ceil(math.log2(ranks))
    unknowns = 6 * groups(ranks, one["nodes"])
    reduction = rounds * (4.5 * (latency + m.overhead_us * 1e-6) + 8 * unknowns / link)
    # One rank's inverse is part of the beat that was measured.
    more_unknowns = unknowns**3 - (6 * groups(1, one["nodes"])) ** 3
    inverse = 2 * more_unknowns / (m.gigaflops * 1e9 * m.core_speed) + rounds * 8 * unknowns**2 / link
    parts = [elements, iterations * max(by_core, by_node)]
    parts += [iterations * halo, iterations * reduction] if ranks > 1 else [0.0, 0.0]
    return parts + [one["newton_iterations"] / 64 * inverse]


def read(name):
    with open(name, encoding="utf-8") as file:
        found = json.load(file)
    return found.get("beats", [found])


def main():
    m = arguments()
    beats = [beat for name in [m.one, *m.measured] for beat in read(name)]
    one = beats[0]
    measured = {one["threads"]: one["seconds_total"]}
    for beat in beats[1:]:
        if beat["nodes"] != one["nodes"]:
            raise SystemExit(f"a beat of {beat['nodes']} nodes; expected {one['nodes']}, as in {m.one}")
        measured[beat["threads"]] = beat["seconds_total"]
    ranks = sorted({1, *measured, *(int(word) for word in m.ranks.split(","))})
    print(f"{one['nodes']} nodes, {one['elements']} elements, {one['krylov_iterations']} Krylov iterations")
    print("| ranks | elements s | matrix s | halos s | reductions s | levels s | beat s | faster | efficiency | measured s |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    first = sum(predict(one, 1, m))
    for r in ranks:
        parts = predict(one, r, m)
        total = sum(parts)
        shown = " | ".join(f"{part:.2f}" for part in parts)
        found = f"{measured[r]:.2f}" if r in measured else ""
        print(f"| {r} | {shown} | {total:.2f} | {first / total:.1f} | {first / total / r:.2f} | {found} |")


main()
