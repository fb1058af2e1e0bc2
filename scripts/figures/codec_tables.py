"""Tables of coders and of streams."""
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


RUNS = {
    "reef": "reef, `test_block`, given prior",
    "mapped": "reef, `test_block`, `nvsprior map`",
    "t1": "T1, the scene as mapped",
    "t2": "T2, a new object",
    "t4": "T4, four weeks later",
}
SHORT = {"reef": "reef, given prior", "mapped": "reef, `map`", "t1": "T1", "t2": "T2", "t4": "T4"}
SHOWN = {run: (34, 35, 36) if run == "t1" else (32, 33, 34) for run in RUNS}


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


def coders():
    """The coders of each run's rates: their names, and by run their rows."""
    rows = {run: {row["coder"]: row for row in values(f"codecs-{run}")["rates"]} for run in RUNS}
    return list(rows["reef"]), rows


def rates():
    """Bytes at three levels, by coder and run."""
    names, rows = coders()

    def cell(run, coder):
        return ", ".join(number(rows[run][coder][column(n)]) for n in SHOWN[run])
    head = [f"{SHORT[run]}: {', '.join(map(str, SHOWN[run]))} dB" for run in RUNS]
    return table(["coder", *head], [[name, *[cell(run, name) for run in RUNS]] for name in names])


def bd_rates():
    names, rows = coders()
    return table(["coder", *[SHORT[run] for run in RUNS]], [
        [name, *[change(rows[run][name]["wavelet_bd_rate"]) for run in RUNS]]
        for name in names if not name.startswith(OWN)])


def similarity():
    """The luma's SSIM and MS-SSIM at equal bytes and at one PSNR."""
    rows = {run: {row["coder"]: row for row in values(f"codecs-{run}")["similarity"]} for run in ("reef", "t2")}
    places = [(run, place) for run in rows for place in ("300_bytes", "33_db")]

    def cell(coder, run, place):
        return ", ".join(number(rows[run][coder][f"{measure}_at_{place}"], 3) for measure in ("ssim", "ms_ssim"))
    head = [f"{SHORT[run]}, {place.replace('_db', ' dB').replace('_', ' ')}" for run, place in places]
    return table(["coder", *head], [[coder, *[cell(coder, *place) for place in places]] for coder in rows["reef"]])


def beside_webp():
    rows = [(text, values(f"codecs-{name}")["beside_webp"]) for name, text in RUNS.items()]
    return table(["run", "cases", "of these worse", "least gain", "mean"], [
        [text, row["cases"], row["worse"], f"{row['least_gain']:.2f} dB", f"{row['mean_gain']:.2f} dB"]
        for text, row in rows])


def coder_times():
    rows = values("codecs-mapped")["times"]
    return table(["rate", "payload, bytes", "PSNR, dB", "encode", "decode", "filter"], [
        [row["rate"], number(row["payload"]), number(row["psnr"], 2),
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
    "rates": rates,
    "bd-rates": bd_rates,
    "similarity": similarity,
}
