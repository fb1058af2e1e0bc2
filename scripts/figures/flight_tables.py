"""Tables of training, of sizes, of sites in blocks, and of links."""
from page import table, values

MIB = 1 << 20


def mapping():
    found = values("mapping")
    steps = sorted({row["step"] for row in found["curve"]})
    at = {(row["step"], row["split"]): row for row in found["curve"]}
    shown = [step for step in steps if step in (400, 1200, 2000, 4000, 6000, steps[-1])]
    splits = sorted({row["split"] for row in found["curve"]})
    return table(["step", "CPU seconds", "splats", *[f"`{split}`" for split in splits]], [
        [f"{step:.0f}", f"{at[step, splits[0]]['cpu_seconds']:.0f}", f"{at[step, splits[0]]['splats']:,.0f}",
         *[f"{at[step, split]['psnr_db']:.2f} dB" for split in splits]] for step in shown])


def mapping_bytes():
    found = values("mapping")["bytes"]
    return table(["prior", "31 dB", "32 dB", "33 dB"], [
        [text, *[f"{found[name][level]['bytes']:.0f}" for level in ("31", "32", "33")]]
        for name, text in (("given", "the reef's shipped prior"), ("mapped", "trained by `nvsprior map`"))])


def sizes():
    return table(["size", "render", "bytes at 31, 32, 33 dB", "search, CPU time", "device memory"], [
        [f"{row['width']}×{row['height']}", f"{row['render_psnr_db']:.2f} dB",
         ", ".join(f"{at['bytes']:,.0f}" for at in row["at_psnr"]), f"{row['search_cpu_ms']:.0f} ms",
         f"{row['device_bytes'] / 1e6:.0f} MB"]
        for row in values("sizes")["rows"]])


STAGES = {"project": "picture", "bin_emit": "picture", "splat": "picture", "splat_flow": "sums, flow"}


def stages():
    """Milliseconds of the longest stages by size."""
    found = values("stages")

    def stage(name):
        return lambda size: next(s["ms"] for s in size["stages"] if (s["job"], s["name"]) == (STAGES[name], name))
    rows = [(f"`{name}`", stage(name)) for name in STAGES]
    rows += [("a forward render", lambda size: size["forward_render_ms"]),
             ("a steady frame, without coding", lambda size: size["frame_ms"])]
    return table(["stage", *[f"{name} wide, ms" for name in found]], [
        [text, *[f"{of(size):.1f}" for size in found.values()]] for text, of in rows])


def coder_cpu():
    """CPU milliseconds of the coder, encode and decode, by rate and size."""
    found = values("sizes")["rows"]
    return table(["rate", *[f"{row['width']}×{row['height']}" for row in found]], [
        [rate["rate"], *[f"{at['encode_cpu_ms']:.0f}, {at['decode_cpu_ms']:.0f}" for at in of_rate]]
        for rate, *of_rate in zip(found[0]["coder"], *(row["coder"] for row in found))])


def sites():
    return table(["splats of the site", "a frame", "host memory of the process", "device memory",
                  "splats on the device"], [
        [f"{row['splats']:,}", f"{row['frame_ms']:.0f} ms", f"{row['host_bytes'] / MIB:.0f} MiB",
         f"{row['device_bytes'] / MIB:.0f} MiB", f"{row['splats_on_device']:,}"] for row in values("sites")["rows"]])


def flight():
    found = values("sites")["flight"]
    return table(["the flight", ""], [
        ["copies, blocks, splats", f"{found['copies']:.0f}, {found['blocks']:,}, {found['splats']:,}"],
        ["frames", f"{found['frames']:,}"],
        ["certain of their pose", f"{found['certain']:,}"],
        ["waited for blocks", f"{found['frames_that_waited']}"],
        ["a frame, median", f"{found['frame_ms']:.0f} ms"],
        ["the longest", f"{found['longest_ms']:.0f} ms"],
        ["the longest that did not wait", f"{found['longest_ms_without_waiting']:.0f} ms"],
        ["packets that differ from those of the prior loaded whole", f"{found['packets_that_differ']}"]])


def percent(loss):
    return "none" if loss == 0 else f"{100 * loss:.0f} %"


def link_losses():
    runs = values("link")["runs"]
    names = [(mtu, burst) for mtu in (64, 256) for burst in (1, 4)]
    first = runs["loss-64-1"]
    return table(["modem frames", "losses", *[percent(run["loss"]) for run in first]], [
        [f"{mtu} bytes", "one by one" if burst == 1 else f"bursts of {burst}",
         *[f"{run['shown_psnr']:.2f} dB" for run in runs[f"loss-{mtu}-{burst}"]]] for mtu, burst in names])


def link_modes():
    runs = values("link")["runs"]
    named = {"loss-64-1": "none (all-intra)", "keys": "the last intra frame, every 8 (`keys`)",
             "layers": "layers of four, an intra frame every 16 (`layers`)",
             "chain": "the frame before, an intra frame every 16 (`chain`)"}
    shown = [0.0, 0.05, 0.2]
    return table(["frames are predicted from", *[percent(loss) for loss in shown]], [
        [text, *[f"{run['shown_psnr']:.2f} dB" for run in runs[name] if run["loss"] in shown]]
        for name, text in named.items()])


def link_poses():
    found = values("link")["poses"]
    named = {"reef": "reef `test_block`, 15/s, given prior", "T1": "T1, 3/s", "T2": "T2, 3/s"}
    return table(["run", "stated: steady", "PSNR", "predicted poses: steady", "predicted", "PSNR"], [
        [text, f"{found[f'{run}-stated']['steady']:.1f}", f"{found[f'{run}-stated']['psnr']:.2f} dB",
         f"{found[f'{run}-predicted']['steady']:.1f}", f"{found[f'{run}-predicted']['predicted']:.1f}",
         f"{found[f'{run}-predicted']['psnr']:.2f} dB"] for run, text in named.items()])


TABLES = {
    "mapping": mapping,
    "mapping-bytes": mapping_bytes,
    "sizes": sizes,
    "coder-cpu": coder_cpu,
    "stages": stages,
    "sites": sites,
    "flight": flight,
    "link-losses": link_losses,
    "link-modes": link_modes,
    "link-poses": link_poses,
}
