"""Tables of searches, of the demo, and of stability."""
from page import JOBS, table, values


def demo():
    return table(["run", "method", "bytes", "PSNR, dB", "ms per frame"], [
        [row["run"], row["method"], f"{row['bytes']:.0f}", f"{row['psnr']:.2f}", f"{row['milliseconds']:.0f}"]
        for row in values("demo")["rows"]])


STARTS = {
    "steady": "the frames before (a steady run)",
    "perturbed_3deg": "off by up to 0.11 units and 3° per axis",
    "perturbed_10deg": "off by up to 0.3 units and 10° per axis",
    "bfgs": "the frames before, by BFGS, as in the paper",
}


def reef_starts():
    reef = values("reef")
    return table(["starts", "ms per frame", "in renders, median and 95 %", "failed"], [
        [text, f"{reef[kind]['frame_ms']:.0f}",
         f"{reef[kind]['in_forward_renders']:.1f}, {reef[kind]['in_forward_renders_p95']:.1f}",
         f"{reef[kind]['failures']} of {reef[kind]['trials']}"]
        for kind, text in STARTS.items()])


def reef_times():
    reef = values("reef")
    return table(["of the reef", "ms, median"], [
        ["one forward render", f"{reef['forward_render_ms']:.1f}"],
        ["coding its difference", f"{reef['code_ms']['median']:.1f}"]])


def steady_renders():
    runs = [values(name) for name in ("reef", "t1", "t2")]

    def row(text, cell):
        return [text, *[cell(run) for run in runs]]
    return table(["", "reef", "T1", "T2"], [
        row("steady frame, in renders", lambda run: f"{run['steady']['in_forward_renders']:.1f}"),
        row("start off by up to 3°", lambda run: f"{run['perturbed_3deg']['in_forward_renders']:.1f}"),
        row("start off by up to 10°", lambda run: f"{run['perturbed_10deg']['in_forward_renders']:.1f}"),
        row("failures of all", lambda run: str(sum(run[kind]["failures"] for kind in list(STARTS)[:3]))
            + f" of {sum(run[kind]['trials'] for kind in list(STARTS)[:3])}"),
        row("dB short in the median of steady frames", lambda run: f"{run['steady']['db_short']['median']:.3f}")])


def commands():
    counts = values("reef")["commands"]
    names = ["dispatches", "fills", "copies", "barriers"]
    return table(["", *names], [
        [text, *[counts[kind][name] for name in names]]
        for kind, text in (("run", "that do something"), ("unused", "of unused slots"))])


def ceilings():
    reef = values("reef")
    gflops, rate = reef["ceilings"]["flops"] / 1e9, reef["ceilings"]["copy_bytes"] / 1e9
    drawn = {stage["name"] for stage in reef["stages"] if stage["job"] == "picture"} - {"copy"}
    chosen = [stage for stage in reef["stages"] if stage["name"] != "copy" and stage["job"] in JOBS
              and (stage["job"] == "picture" or stage["name"] not in drawn)]
    return table(["stage", "of", "ms", f"share of {rate:.1f} GB/s", f"share of {gflops:.0f} GFLOP/s"], [
        [f"`{s['name']}`", JOBS[s["job"]], f"{s['ms']:.2f}", f"{100 * s['share_of_copy']:.0f} %",
         f"{100 * s['share_of_fma']:.0f} %"] for s in chosen])


def by_bins(name, methods):
    """Rows for each bin and method: what the perturbation is, and the method's medians."""
    bins = values(name)["bins"]
    order = {method: index for index, method in enumerate(methods)}
    chosen = [row for row in bins if row["method"] in order and row["trials"]]
    return sorted(chosen, key=lambda row: (row["kind"] != "rotation", row["from"], order[row["method"]]))


def span(row):
    digits = 0 if row["kind"] == "rotation" else 2
    unit = "°" if row["kind"] == "rotation" else " m"
    return f"{row['from']:.{digits}f} to {row['to']:.{digits}f}{unit}"


def medians(row):
    return [f"{row['found']} of {row['trials']}", f"{row['render_psnr']:.2f}", f"{row['energy']:.5f}",
            f"{row['bytes']:.0f}", f"{row['iterations']:.0f}", f"{row['in_forward_renders']:.0f}"]


MEDIANS = ["found", "PSNR, dB", "energy", "bytes", "iterations", "forward"]


def ablation_losses():
    names = {"bfgs": "MSE by BFGS", "matching": "matching"}
    return table(["off by", "method", *MEDIANS],
                 [[span(row), names[row["method"]], *medians(row)] for row in by_bins("ablation", names)])


def ablation_optimizers():
    return table(["off by", "method", *MEDIANS], [
        [span(row), row["method"], *medians(row)] for row in by_bins("ablation", ["bfgs", "gauss-newton"])])


def ablation_starts():
    return table(["method", "start", *MEDIANS], [
        [row["method"], row["source"], *medians(row)] for row in values("ablation")["starts"]])


EXPECTED = {
    "poses": "views whose equations are ill-conditioned or singular: the search ends no worse than it began",
    "units": "a scene in other units finds the same pose, to a thousandth of the depth; a million units from the "
             "origin, to a hundredth",
    "optimisers": "on flat, noisy and deceiving objectives each ends by itself, no worse than it began",
    "splats": "needles, specks, scales from e⁻⁴⁰ to e⁴⁰, opacities of 0 and 1: as by the twin; NaN and ∞ are left out; "
              "what the device does not hold is refused",
    "pictures": "frames without the prior, cameras from 1×1 to 4096×4096: the topside shows what was encoded, or a "
                "refusal names the bound",
    "precision": "medians of 16 bits right and more in every stage",
    "devices": "every device of the machine against the first: fewer than one pixel in a hundred differs",
    "random": "10,000 random scenes with extreme fields: numbers within their bounds, typed errors only, no hang",
}


def stability():
    return table(["group", "rows", "as expected", "what is expected"], [
        [g["group"], g["rows"], g["as_expected"], EXPECTED[g["group"]]]
        for g in values("stability")["groups"]])


TABLES = {
    "demo": demo,
    "reef-starts": reef_starts,
    "reef-times": reef_times,
    "steady-renders": steady_renders,
    "commands": commands,
    "ceilings": ceilings,
    "ablation-losses": ablation_losses,
    "ablation-optimizers": ablation_optimizers,
    "ablation-starts": ablation_starts,
    "stability": stability,
}
