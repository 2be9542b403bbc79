"""Runs the program with and without fused multiply-add and compares every byte of its results.

    same_bits.py VRDP SCENES [--effects GROUPS] [--simulations N] [--emulate N]

Two kinds of processor: this one, and one whose C library is kept from FMA and AVX2 (GLIBC_TUNABLES). For the first
--emulate scenes there is a third, a Nehalem of 2008 in qemu-x86_64, which lacks the instructions themselves. SCENES is a folder of scenes: each is
fitted and simulated, N times in all (by default once a scene), each 20th trace verified on the other kind. GROUPS is a folder of
groups of scenes: `discover` runs on each. Only the field `seconds` may differ.
"""

import argparse
import filecmp
import json
import os
import pathlib
import subprocess
import sys
import tempfile

WITHOUT_FMA = "glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2,-AVX2_Usable,-FMA_Usable"


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("vrdp")
    parser.add_argument("scenes", type=pathlib.Path)
    parser.add_argument("--effects", type=pathlib.Path)
    parser.add_argument("--simulations", type=int, default=0)
    parser.add_argument("--emulate", type=int, default=0)
    arguments = parser.parse_args()
    kinds = {"fma": ([arguments.vrdp], {}), "no-fma": ([arguments.vrdp], {"GLIBC_TUNABLES": WITHOUT_FMA})}
    emulated = {**kinds, "nehalem": (["qemu-x86_64", "-cpu", "Nehalem", arguments.vrdp], {})}
    with tempfile.TemporaryDirectory() as work:
        work = pathlib.Path(work)
        scenes = sorted(path.parent for path in arguments.scenes.rglob("observed.json"))
        few = set(scenes[: arguments.emulate])

        def kinds_of(scene):
            return emulated if scene in few else kinds

        print(f"{fits(kinds_of, work, scenes)} fits", end="")
        print(f", {simulations(kinds_of, work, scenes, arguments.simulations)} simulations", end="")
        if arguments.effects:
            groups = sorted({path.parent.parent for path in arguments.effects.rglob("observed.json")})
            print(f", {discoveries(kinds, work, groups)} discoveries", end="")
        print(f": equal bytes on {', '.join(kinds)}; {len(few)} scenes on nehalem")


def run(kind, *words):
    program, environment = kind
    command = [*program, *map(str, words)]
    done = subprocess.run(command, env={**os.environ, **environment}, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{' '.join(command)}: {done.stdout}{done.stderr}")


def without_seconds(value):
    if isinstance(value, dict):
        return {key: without_seconds(inner) for key, inner in value.items() if key not in ("seconds", "trace")}
    return [without_seconds(inner) for inner in value] if isinstance(value, list) else value


def same(results):
    """Whether the JSON files are equal to the last digit, but for times and paths."""
    first, *others = [json.dumps(without_seconds(json.loads(path.read_text()))) for path in results]
    for path, other in zip(results[1:], others):
        if other != first:
            sys.exit(f"{path.name} differs from {results[0].name}")


def on_each(kinds, work, name, *words, trace=False):
    """The traces, if asked for; their bytes are compared too."""
    results, traces = [], []
    for label, kind in kinds.items():
        results.append(work / f"{name}-{label}.json")
        traces.append(work / f"{name}-{label}.mcap")
        run(kind, *words, *(["--trace", traces[-1]] if trace else []), "--quiet", "--json", results[-1])
    same(results)
    for other in traces[1:] if trace else []:
        if not filecmp.cmp(traces[0], other, shallow=False):
            sys.exit(f"{other.name} differs from {traces[0].name}")
    return traces


def fits(kinds_of, work, scenes):
    for scene in scenes:
        on_each(kinds_of(scene), work, f"fit-{scene.name}", "fit", scene)
    return len(scenes)


def simulations(kinds_of, work, scenes, count):
    """Each scene as it was recorded, then with one object after the other removed or made heavier."""
    variants = []
    for scene in scenes:
        objects = json.loads((scene / "observed.json").read_text())["object_property"]
        ids = [o["object_id"] for o in objects]
        edits = [[], *(["--remove", i] for i in ids), *(["--mass", f"{i}=5"] for i in ids)]
        variants += [(turn, scene, edit) for turn, edit in enumerate(edits)]
    variants.sort(key=lambda variant: variant[:2])
    variants = variants[: count or len(scenes)]
    for number, (_, scene, edit) in enumerate(variants):
        kinds = kinds_of(scene)
        traces = on_each(kinds, work, f"{number}-{scene.name}", "simulate", scene, *edit, trace=True)
        if number % 20 == 0:
            run(list(kinds.values())[-1], "replay", "--verify", traces[0])
    return len(variants)


def discoveries(kinds, work, groups):
    for group in groups:
        on_each(kinds, work, f"discover-{group.name}", "discover", group)
    return len(groups)


main()
