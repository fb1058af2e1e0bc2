"""Tables of coders and of streams."""
from functools import partial

from page import table, values

LEVELS = range(30, 37)
NONE = "–"
OWN = "wavelet"


def number(value, digits=0):
    return NONE if value is None else f"{value:.{digits}f}"


def change(share):
    return NONE if share is None else f"{100 * share:+.0f} %".replace("-", "−")


def others(rates):
    """The rows of coders that are not ours, in any form."""
    return [row for row in rates if not row["coder"].startswith(OWN)]


def column(level):
    return f"bytes_at_{level}_db"


def reached(rates):
    """The levels that this coder and another one reach."""
    own = next(row for row in rates if row["coder"] == OWN)
    return [n for n in LEVELS if own[column(n)] and any(row[column(n)] for row in others(rates))]


def rates(name):
    rows = values(f"codecs-{name}")["rates"]
    levels = [n for n in LEVELS if any(row[column(n)] for row in rows)]
    return table(["coder", *[f"{n} dB" for n in levels], "BD-rate"], [
        [row["coder"], *[number(row[column(n)]) for n in levels],
         change(row["wavelet_bd_rate"])] for row in rows])


RUNS = {
    "reef": "reef, `test_block`, given prior",
    "mapped": "reef, `test_block`, `nvsprior map`",
    "t1": "T1, the scene as mapped",
    "t2": "T2, a new object",
    "t4": "T4, four weeks later",
}


def shares():
    """This coder's share of the bytes of the best other one, and which one that is."""
    def cells(name):
        rows = values(f"codecs-{name}")["rates"]
        own = next(row for row in rows if row["coder"] == OWN)
        both = reached(rows)
        for n in LEVELS[1:]:
            if n in both:
                best = min((row for row in others(rows) if row[column(n)]), key=lambda row: row[column(n)])
                yield f"{100 * own[column(n)] / best[column(n)]:.0f} % ({best['coder']})"
            else:
                yield ""
    return table(["run", *[f"{n} dB" for n in LEVELS[1:]]], [[text, *cells(name)] for name, text in RUNS.items()])


def similarity(name, measure):
    rows = values(f"codecs-{name}")["similarity"]
    places = ["100_bytes", "300_bytes", "1000_bytes", "33_db", "35_db"]
    return table(["coder", *[place.replace("_db", " dB").replace("_", " ") for place in places]], [
        [row["coder"], *[number(row[f"{measure}_at_{place}"], 3) for place in places]] for row in rows])


def beside_webp():
    rows = [(text, values(f"codecs-{name}")["beside_webp"]) for name, text in RUNS.items()]
    return table(["run", "cases", "of these worse", "WebP's payloads, bytes", "least gain", "mean"], [
        [text, row["cases"], row["worse"], f"{row['bytes'][0]:.0f} to {row['bytes'][1]:.0f}",
         f"{row['least_gain']:.2f} dB ({row['least_gain_at'][1]:.0f} bytes)", f"{row['mean_gain']:.2f} dB"]
        for text, row in rows])


def coder_times():
    rows = values("codecs-mapped")["times"]
    return table(["rate", "codings", "payload, bytes", "PSNR, dB", "encode", "decode", "filter"], [
        [row["rate"], number(row["codings"], 1), number(row["payload"]), number(row["psnr"], 2),
         *[number(row[f"{what}_in_forward_renders"], 2) for what in ("encode", "decode", "filter")]] for row in rows])


MODES = {"intra": "each frame by itself", "chain": "stream, `chain`", "layers": "stream, `layers`",
         "keys": "stream, `keys`"}
STREAMS = {"reef": "reef, given prior, 15 fps", "mapped": "reef, a prior of `map`, 15 fps", "T2": "T2, 3 fps",
           "T4": "T4, 3 fps"}


def streams():
    found = values("streams")["bytes"]
    return table(["run", "mode", "31 dB", "32 dB", "33 dB"], [
        [text if mode == "intra" else "", MODES[mode], *[number(found[f"{run}-{mode}"][n]["bytes"]) for n in
                                                        ("31", "32", "33")]]
        for run, text in STREAMS.items() for mode in MODES if f"{run}-{mode}" in found])


TABLES = {
    "shares": shares,
    "beside-webp": beside_webp,
    "coder-times": coder_times,
    "streams": streams,
    **{f"rates-{name}": partial(rates, name) for name in RUNS},
    **{f"{measure.replace('_', '-')}-{name}": partial(similarity, name, measure)
       for measure in ("ssim", "ms_ssim") for name in ("reef", "t2")},
}
