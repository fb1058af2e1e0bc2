"""How the documents' tables are made of docs/results. Each entry of TABLES makes one, as lines of Markdown."""
import codec_tables
import flight_tables
import measurements
import results
import search_tables
from page import read, table


def sources():
    known = [results.read(measurement.name) for measurement in measurements.ALL]
    read.update(result["name"] for result in known)
    groups = {}
    for r in known:
        link = f"[{r['name']}](results/{r['name']}.json)"
        groups.setdefault((r["date"], r["commit"], f"{r['device']}; {r['machine']}"), []).append(link)
    rows = [[", ".join(names), *made] for made, names in groups.items()]
    devices = ["", *[row[-1] for row in rows]]
    return table(["results", "date", "commit", "device and processor"], [
        [*row[:-1], "" if row[-1] == before else row[-1]] for row, before in zip(rows, devices)])


TABLES = {"sources": sources} | search_tables.TABLES | codec_tables.TABLES | flight_tables.TABLES
