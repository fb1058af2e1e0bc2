"""A coder of your own beside ours: JPEG by Pillow, on the frames that `nvsprior-lab paper bench` wrote.

Usage: own_coder.py REPORT/exchange OUT; then give `--learned OUT`. docs/paper.md says what the files hold.
"""

import io
import json
import pathlib
import sys
import time

from PIL import Image

exchange, out = map(pathlib.Path, sys.argv[1:])
for quality in (10, 30, 50, 70, 90):
    folder = out / f"pillow-jpeg@{quality}"
    (folder / "pictures").mkdir(parents=True, exist_ok=True)
    (folder / "method.json").write_text(json.dumps({"of": "frames", "setting": f"quality {quality}"}))
    rows = ["name,bytes,encode_ms,decode_ms"]
    for name in json.loads((exchange / "manifest.json").read_text())["frames"]:
        frame, file = Image.open(exchange / "frames" / f"{name}.png").convert("RGB"), io.BytesIO()
        times = [time.perf_counter()]
        frame.save(file, "JPEG", quality=quality)
        times.append(time.perf_counter())
        Image.open(file).save(folder / "pictures" / f"{name}.png")
        times.append(time.perf_counter())
        # Headers and tables are the same in each frame, and none of our rows counts its container.
        payload = len(file.getvalue()) - file.getvalue().index(b"\xff\xda")
        rows.append(f"{name},{payload},{1e3 * (times[1] - times[0])},{1e3 * (times[2] - times[1])}")
    (folder / "frames.csv").write_text("\n".join(rows) + "\n")
