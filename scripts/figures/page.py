"""Lines of Markdown, made of docs/results."""
import results

# What the stages of these jobs of a bench's report make, in the documents' words.
JOBS = {"picture": "picture", "sums, flow": "evaluation"}

# Names of the results that tables have read.
read = set()


def values(name):
    read.add(name)
    return results.read(name)["values"]


def table(header, rows):
    lines = [header, ["---"] * len(header), *rows]
    return "".join("| " + " | ".join(str(cell) for cell in line) + " |\n" for line in lines)
