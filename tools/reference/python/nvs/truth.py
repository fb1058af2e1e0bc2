"""Truth maps: docs/format/packet.md."""

import re
from pathlib import Path

import numpy as np

from .bits import RangeDecoder

THRESHOLDS = [16, 12, 20, 8]
TEXT = (Path(__file__).resolve().parents[4] / "docs/format/chances.txt").read_text(encoding="utf-8")


def _chances(name):
    body = re.search(rf"^{name} =\n((?:  [\d ]+\n)+)", TEXT, re.M).group(1)
    return [int(v) for v in body.split()]


OFF, WRONG, TAKES = map(_chances, ("OFF", "WRONG", "TAKES"))
RENDERED, MENDED, DIFFERS, IS_WRONG = range(4)


class TruthDecoder:
    def __init__(self, width, height):
        self.size = width, height
        self.shape = (height + 15) // 16, (width + 15) // 16
        self.key, self.key_frame = np.zeros(self.shape, int), None

    def read(self, frame, data):
        """Marks of a map; None: it is lost."""
        first = data[0]
        form, predicted, whole = first & 3, first >> 2 & 1, first >> 3 & 1
        if form == 0:
            marks = np.full(self.shape, MENDED if whole else RENDERED)
        else:
            if predicted and self.key_frame != (frame - (data[1] >> 4)) % (1 << 16):
                return None
            start = 2
            if data[1] & 15 == 15:
                start = next((i + 1 for i in range(2, 5) if data[i] < 128), 5)
            marks = self._cells(RangeDecoder(data[start:]), whole, predicted, 1 << form - 1)
        if not predicted:
            self.key, self.key_frame = marks, frame % (1 << 16)
        return marks

    def _cells(self, coder, whole, predicted, side):
        rows, columns = (-(-n // side) for n in self.shape)
        cells = np.zeros((rows, columns), int)
        before = np.zeros((rows, columns), int)
        for (y, x), mark in np.ndenumerate(self.key):
            before[y // side, x // side] = max(before[y // side, x // side], mark)
        at = lambda of, y, x: of[y, x] if 0 <= y < rows and 0 <= x < columns else RENDERED
        off = lambda mark: int(mark >= DIFFERS)
        for y in range(rows):
            for x in range(columns):
                left, above = at(cells, y, x - 1), at(cells, y - 1, x)
                corners = 4 * off(at(cells, y - 1, x - 1)) + 8 * off(at(cells, y - 1, x + 1))
                around = off(left) + 2 * off(above) + corners
                o = v = l = 0
                if predicted:
                    s = before[y, x]
                    near = sum(off(at(before, y + dy, x + dx)) for dy, dx in ((0, -1), (0, 1), (-1, 0), (1, 0)))
                    o, v, l = 1 + 4 * off(s) + min(3, near), 1 + off(s) + (s == IS_WRONG), 1 + min(s, 2)
                if coder.bit(OFF[16 * o + around]):
                    wrong = coder.bit(WRONG[3 * v + (left == IS_WRONG) + (above == IS_WRONG)])
                    cells[y, x] = IS_WRONG if wrong else DIFFERS
                elif whole or coder.bit(TAKES[9 * l + 3 * min(left, 2) + min(above, 2)]):
                    cells[y, x] = MENDED
        y, x = np.indices(self.shape)
        return cells[y // side, x // side]

    def levels(self, frame, data, start=None):
        """Levels and the first threshold. `start`: render and picture, if the residual's end is missing."""
        marks = self.read(frame, data)
        if marks is None:
            return None
        threshold = np.float32(THRESHOLDS[data[0] >> 6])
        levels = np.where(marks <= MENDED, 0, marks - 1)
        if start:
            least = (np.float32(1) - np.float32(0.8)) * threshold
            levels = np.where((marks == RENDERED) & (self._worst(*start) <= least), 0, 3)
        return levels, threshold

    def _worst(self, render, picture):
        """The worst windows of each block, RMS."""
        width, height = self.size
        squares = ((render.astype(np.int64) - picture) ** 2).sum(2)
        sums = np.pad(squares.cumsum(0).cumsum(1), ((1, 0), (1, 0)))
        worst = np.zeros(self.shape, np.float32)

        def note(block, y0, y1, x0, x1):
            total = sums[y1, x1] - sums[y0, x1] - sums[y1, x0] + sums[y0, x0]
            rms = np.sqrt(np.float32(total) / np.float32(3 * (y1 - y0) * (x1 - x0)))
            worst[block] = max(worst[block], rms)

        w, h = min(16, width), min(16, height)
        for y in range(height - h + 1):
            row = (y + h // 2) // 16
            for x in range(width - w + 1):
                note((row, (x + w // 2) // 16), y, y + h, x, x + w)
            if y % 16 == 0:
                note((row, self.shape[1] - 1), y, y + h, 16 * (self.shape[1] - 1), width)
        last = height // 16 * 16
        if 1 <= last < height:
            for block in range(self.shape[1]):
                note((last // 16, block), last, height, 16 * block, min(16 * block + 16, width))
        return worst
