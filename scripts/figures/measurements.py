"""What is measured for the documents, and by which commands.

Each measurement has the commands, the priors that it is of, and what it reads from the folder OUT that they leave. Of
its values, `exact` are those that every device must give again: bytes, PSNR, counts. All others depend on the machine.
`quick` ones take minutes.
"""
import csv
import dataclasses
import json
from typing import Callable

NVSPRIOR = "target/release/nvsprior"


@dataclasses.dataclass
class Measurement:
    name: str
    priors: list[str]
    commands: list[str]
    read: Callable
    exact: Callable
    quick: bool = False


def load(path):
    return json.loads(path.read_text())


def rows_of_demo(out):
    return {"rows": load(out / "table.json")}


def exact_of_demo(values):
    return [[row["run"], row["method"], round(row["bytes"], 1), round(row["psnr"], 2)]
            for row in values["rows"] if "NVSPrior" in row["method"]]


FIGURES = ["frame_ms", "in_forward_renders", "in_forward_renders_p95", "failures", "trials", "db_short"]


def figures_of(report, kind):
    return {name: report[kind][name] for name in FIGURES}


def bench(out):
    """A bench's report, without the poses."""
    report = load(out / "bench/report.json")
    kinds = ["steady", "perturbed_3deg", "perturbed_10deg"] + [k for k in ("bfgs",) if k in report]
    values = {kind: figures_of(report, kind) for kind in kinds}
    for name in ("frames", "splats", "size", "forward_render_ms", "commands", "ceilings"):
        values[name] = report[name]
    values["code_ms"] = report["steady"]["code_ms"]
    values["stages"] = [{key: stage[key] for key in ("job", "name", "ms", "share_of_copy", "share_of_fma", "bound")}
                        for stage in report["stages"]]
    return values


def exact_of_bench(values):
    return [values["frames"], values["splats"], values["steady"]["failures"], values["commands"]]


def reef(out):
    values = bench(out)
    for coder in ("wavelet", "webp"):
        summary = load(out / f"{coder}.json")
        values[coder] = {name: summary["mean"][name] for name in ("bytes", "psnr", "render_psnr")}
    return values


def exact_of_reef(values):
    coders = [[round(v, 2) for v in values[coder].values()] for coder in ("wavelet", "webp")]
    return exact_of_bench(values) + coders


def ablation(out):
    report = load(out / "ablation/ablation.json")

    def medians(row):
        names = ("render_psnr", "energy", "bytes", "iterations", "full_renders", "in_forward_renders")
        kept = {name: row[name] for name in row if not isinstance(row[name], dict) and name != "share_found"}
        return kept | {name: row[name]["median"] for name in names if row["trials"]}

    best = sorted(best["psnr"] for best in report["best_known"])
    return {
        "frames": report["frames"],
        "splats": report["splats"],
        "size": report["size"],
        "best_known_psnr": best[(len(best) - 1) // 2],
        "bins": [medians(row) for row in report["bins"]],
        "starts": [medians(row) for row in report["starts"]],
    }


def exact_of_ablation(values):
    return [[row["method"], row["kind"], row["from"], row["found"], row["trials"]] for row in values["bins"]]


def stability(out):
    with open(out / "stability.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    groups = {}
    for row in rows:
        group = groups.setdefault(row["group"], {"cases": set(), "rows": 0, "as_expected": 0})
        group["cases"].add(row["case"])
        group["rows"] += 1
        group["as_expected"] += row["as expected"] == "yes"
    return {"groups": [{"group": name, **group, "cases": len(group["cases"])} for name, group in groups.items()]}


def exact_of_stability(values):
    return [list(group.values()) for group in values["groups"]]


DEMO_BENCH = ("{nvsprior} demo --run {run} --draw-only --frames 24 --out OUT && "
              "{nvsprior} demo --frames 1 --out OUT/one > OUT/one.txt && "
              "{nvsprior} bench --prior OUT/one/prior.ply --cameras OUT/{run}/cameras.json --bfgs-frames 0 "
              "--configurations 0 --report OUT/bench")

ABLATION = (f"{NVSPRIOR} demo --frames 8 --run T1 --draw-only --out OUT && "
            f"{NVSPRIOR} demo --frames 1 --out OUT/one > OUT/one.txt && "
            f"{NVSPRIOR} bench --ablation --prior OUT/one/prior.ply --cameras OUT/T1/cameras.json "
            "--ablation-trials 24 --ablation-adam-trials 0 --report OUT/ablation")

ALL = [
    Measurement("demo", ["demo"], [f"{NVSPRIOR} demo --out OUT"], rows_of_demo, exact_of_demo, quick=True),
    Measurement("reef", ["reef"], [
        f"{NVSPRIOR} bench --prior REEF/prior.ply --cameras REEF/cameras.json --split test_block --report OUT/bench",
        f"{NVSPRIOR} encode --prior REEF/prior.ply --cameras REEF/cameras.json --split test_block --quality 10 "
        "--packets OUT/packets --summary OUT/wavelet.json",
        f"{NVSPRIOR} encode --prior REEF/prior.ply --cameras REEF/cameras.json --split test_block --quality 10 "
        "--residual webp --packets OUT/webp --summary OUT/webp.json",
    ], reef, exact_of_reef),
    *[Measurement(run.lower(), ["demo"], [DEMO_BENCH.format(nvsprior=NVSPRIOR, run=run)], bench, exact_of_bench)
      for run in ("T1", "T2")],
    Measurement("ablation", ["demo"], [ABLATION], ablation, exact_of_ablation),
    Measurement("stability", [], [f"{NVSPRIOR} stability --report OUT"], stability, exact_of_stability),
]
