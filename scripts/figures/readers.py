"""Reads what a measurement's commands left in the folder OUT. `exact_…`: what every device must give again."""
import csv
import json
import statistics


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


def csv_rows(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def numbers(row, words=()):
    """A row of a CSV file, with its numbers as such and None in empty cells."""
    return {name: cell if name in words else float(cell) if cell else None for name, cell in row.items()}


def codecs(out):
    folder = out / "codecs"
    frames = [(row["frame"], float(row["webp_bytes"]), float(row["wavelet_psnr"]) - float(row["webp_psnr"]))
              for row in csv_rows(folder / "codecs-frames.csv")]
    least = min(frames, key=lambda row: row[2])
    return {
        "coders": (out / "coders.txt").read_text().splitlines(),
        "missing": [row["coder"] for row in load(folder / "codecs-missing.json")],
        "rates": [numbers(row, ("coder", "input", "mode")) for row in csv_rows(folder / "codecs-rates.csv")],
        "similarity": [numbers(row, ("coder",)) for row in csv_rows(folder / "codecs-similarity.csv")],
        "times": [numbers(row, ("rate",)) for row in csv_rows(folder / "codecs-times.csv")],
        "beside_webp": {
            "cases": len(frames),
            "worse": sum(gain < 0 for _, _, gain in frames),
            "bytes": [min(row[1] for row in frames), max(row[1] for row in frames)],
            "least_gain": least[2],
            "least_gain_at": least[:2],
            "mean_gain": statistics.mean(row[2] for row in frames),
        },
    }


def exact_of_codecs(values):
    return [[row[name] for name in row if name.startswith("bytes")]
            for row in values["rates"] if row["coder"].startswith("wavelet")]


def summaries(out, names):
    """Of `encode --summary` for each level, mean bytes and PSNR: {name: {level: …}}."""
    found = {}
    for name in names:
        for path in sorted(out.glob(f"{name}-*.json")):
            mean = load(path)["mean"]
            level = path.stem.removeprefix(f"{name}-")
            if level.isdigit():
                found.setdefault(name, {})[level] = {key: mean[key] for key in ("bytes", "psnr", "render_psnr")}
    return found


def mapping(out):
    report = load(out / "map/report.json")
    kept = ("splats", "iterations", "pictures", "cpu_seconds", "seconds", "held_out_psnr_by_split", "trained_psnr",
            "iteration_in_forward_renders")
    curve = [numbers(row, ("split",)) for row in csv_rows(out / "map/curve.csv")]
    return {name: report[name] for name in kept} | {
        "curve": curve, "bytes": summaries(out, ("mapped", "given"))}


def exact_of_mapping(values):
    return [[round(row["bytes"], 1) for row in values["bytes"]["given"].values()]]


def streams(out):
    names = sorted({path.stem.rpartition("-")[0] for path in out.glob("*-3?.json")})
    return {"bytes": summaries(out, names)}


def exact_of_streams(values):
    return [[name, [round(row["bytes"], 1) for row in levels.values()]]
            for name, levels in values["bytes"].items() if not name.startswith("mapped")]


def sizes(out):
    return {"rows": load(out / "sizes/sizes.json")}


def exact_of_sizes(values):
    return [[row["width"], round(row["render_psnr_db"], 2), [round(at["bytes"], 1) for at in row["at_psnr"]]]
            for row in values["rows"]]


WIDTHS = (320, 640, 1280)


def stages(out):
    """The device's time by stage, and that of a steady frame, by the pictures' width."""
    reports = {width: load(out / f"{width}/report.json") for width in WIDTHS}
    return {str(width): {
        "stages": [{key: stage[key] for key in ("job", "name", "ms")} for stage in report["stages"]],
        "frame_ms": report["steady"]["frame_ms"],
        "forward_render_ms": report["forward_render_ms"],
        "in_forward_renders": report["steady"]["in_forward_renders"],
    } for width, report in reports.items()}


def exact_of_stages(values):
    return [[stage["name"] for stage in row["stages"]] for row in values.values()]


def sites(out):
    return {"rows": load(out / "site.json"), "flight": load(out / "flight.json")}


def exact_of_sites(values):
    return [[row["splats"] for row in values["rows"]], values["flight"]["packets_that_differ"]]


# Of the packets of a steady run, those that count: after the vehicle has heard what the topside holds, seconds.
STEADY_FROM = 3.5
# The latent part of a packet that states its pose, bytes.
STATED = 19


def poses(out):
    """Mean bytes that are neither residual nor truth map, and PSNR, of a run whose poses are stated or predicted."""
    rows = [row for row in csv_rows(out / "frames.csv") if row["latent_bytes"]]
    steady = [row for row in rows if float(row["seconds"]) >= STEADY_FROM]

    def mean(of):
        overheads = [float(row["latent_bytes"]) + float(row["framing_bytes"]) for row in of]
        return statistics.mean(overheads) if overheads else None
    return {"steady": mean(steady), "predicted": mean([r for r in steady if float(r["latent_bytes"]) < STATED]),
            "psnr": load(out / "link.json")["shown_psnr"]}


LINK = ("loss", "burst", "mtu", "bit_rate", "latency", "shown_psnr", "sent_psnr", "render_psnr", "shown", "deepest_dip",
        "worst_second_bits", "bytes")


def link_runs(path):
    return [{key: run[key] for key in LINK} for run in load(path / "link.json")["settings"]]


def link(out):
    named = {path.parent.name: path.parent for path in sorted(out.glob("*/link.json"))}
    return {
        "runs": {name: link_runs(path) for name, path in named.items() if not name.startswith("poses-")},
        "poses": {name.removeprefix("poses-"): poses(path) for name, path in named.items()
                  if name.startswith("poses-")},
    }


def exact_of_link(values):
    return values["poses"]
