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
    return table(["result", "date", "commit", "device", "processor"], [
        [f"[{r['name']}](results/{r['name']}.json)", r["date"], r["commit"], r["device"], r["machine"]] for r in known])


TABLES = {"sources": sources} | search_tables.TABLES | codec_tables.TABLES | flight_tables.TABLES
