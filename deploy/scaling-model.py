#!/usr/bin/env python3
"""How long a beat takes on many ranks: a model from figures of one, and what was measured beside it.

    deploy/scaling-model.py ONE.json [MEASURED.json …]

ONE.json is what `cardiotwin-dev bench beat --nodes N --threads 1 --json` printed, or --threads 1,2,…: then what follows the
first beat is measured, too; each MEASURED.json a beat of the same mesh on more
ranks, as deploy/scaling.sbatch leaves them. Constants of the machine are options. Plain Python 3, nothing to install.

A beat of E elements and N nodes on R ranks of nodes with C cores:

    elements    (seconds of ONE less its Krylov iterations) · overlap / R,  overlap = 1 + 0.145 (1000 R / N)^(1/3)
    matrix      bytes of an iteration · overlap / R over the smaller of a core's rate in ONE and its share of the node's bandwidth;
                the second only where a rank's share of the matrix does not fit its share of the cache
    halos       2.2 an iteration, 35 bytes a ghost together: latency, neighbours · overhead, bytes over the link
    reductions  2.7 an iteration: ⌈log₂ R⌉ rounds of the latency
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
    parser.add_argument("--link-gb-per-s", type=float, default=2.0, help="bandwidth of a rank's messages")
    return parser.parse_args()


def overlap(ranks, nodes):
    """Elements of the fullest rank over an equal share: 1.145 for 1,000 nodes a rank, as measured on 8 ranks."""
    return 1.0 if ranks == 1 else 1.0 + 0.145 * (1000.0 * ranks / nodes) ** (1 / 3)


def neighbours(ranks):
    """A wall one or two parts thick: 1, 3 and 6 were measured on 2, 4 and 8 ranks."""
    return {1: 0, 2: 1, 4: 3}.get(ranks, min(ranks - 1, 8))


def predict(one, ranks, m):
    iterations = one["krylov_iterations"]
    own = one["ms_per_krylov_iteration"] * 1e-3
    rest = max(one["seconds_total"] - iterations * own, 0.0)
    more = overlap(ranks, one["nodes"])
    elements = rest / m.core_speed * more / ranks
    share = one["MB_per_krylov_iteration"] * 1e6 * more / ranks
    by_core = share / (one["MB_per_krylov_iteration"] * 1e6 / own * m.core_speed)
    on_node = min(ranks, m.cores)
    by_node = share * on_node / (m.node_gb_per_s * 1e9) if share > m.cache_mb * 1e6 else 0.0
    latency = (m.near_us if ranks <= m.cores else m.far_us) * 1e-6
    # Ghosts of a rank: 300 of 1,000 nodes a rank, as an area.
    ghosts = 0.0 if ranks == 1 else 300.0 * (one["nodes"] / ranks / 1000.0) ** (2 / 3)
    halo = 2.2 * (latency + neighbours(ranks) * m.overhead_us * 1e-6 + 35 * ghosts / (m.link_gb_per_s * 1e9))
    reduction = 2.7 * math.ceil(math.log2(ranks)) * (latency + m.overhead_us * 1e-6)
    parts = [elements, iterations * max(by_core, by_node)]
    parts += [iterations * halo, iterations * reduction] if ranks > 1 else [0.0, 0.0]
    return parts


def read(name):
    with open(name, encoding="utf-8") as file:
        found = json.load(file)
    return found.get("beats", [found])


def main():
    m = arguments()
    beats = [beat for name in [m.one, *m.measured] for beat in read(name)]
    one = beats[0]
    if one["threads"] != 1:
        raise SystemExit(f"{m.one}: a beat on {one['threads']} ranks; expected one on one")
    measured = {}
    for beat in beats[1:]:
        if beat["nodes"] != one["nodes"]:
            raise SystemExit(f"a beat of {beat['nodes']} nodes; expected {one['nodes']}, as in {m.one}")
        measured[beat["threads"]] = beat["seconds_total"]
    ranks = sorted({1, *measured, *(int(word) for word in m.ranks.split(","))})
    print(f"{one['nodes']} nodes, {one['elements']} elements, {one['krylov_iterations']} Krylov iterations")
    print("| ranks | elements s | matrix s | halos s | reductions s | beat s | faster | efficiency | measured s |")
    print("|---|---|---|---|---|---|---|---|---|")
    first = sum(predict(one, 1, m))
    for r in ranks:
        parts = predict(one, r, m)
        total = sum(parts)
        shown = " | ".join(f"{part:.2f}" for part in parts)
        found = f"{measured[r]:.2f}" if r in measured else ""
        print(f"| {r} | {shown} | {total:.2f} | {first / total:.1f} | {first / total / r:.2f} | {found} |")


main()
