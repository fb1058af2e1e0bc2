"use strict";
// The region of interest: marked by dragging, or with the keyboard. Parts of the picture, 0 to 1.

class RegionMarker {
  // `parts`: gives parts of the picture for a pointer. `send`: tells the console; `null`: no region any more.
  constructor(stage, parts, send) {
    this.send = send;
    this.drawn = null;
    this.start = null;
    stage.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      stage.setPointerCapture(event.pointerId);
      this.start = parts(event);
      this.drawn = null;
    });
    stage.addEventListener("pointermove", (event) => {
      if (this.start) this.drawn = this.between(this.start, parts(event));
    });
    const end = (event) => {
      if (!this.start) return;
      const region = this.between(this.start, parts(event));
      this.start = this.drawn = null;
      // A click is no region.
      if (region[2] - region[0] > 0.02 && region[3] - region[1] > 0.02) this.send(region);
    };
    stage.addEventListener("pointerup", end);
    stage.addEventListener("pointercancel", () => { this.start = this.drawn = null; });
  }

  between([ax, ay], [bx, by]) {
    return [Math.min(ax, bx), Math.min(ay, by), Math.max(ax, bx), Math.max(ay, by)];
  }

  // Takes a key; `region` is the one that holds. `true`: it was one of these.
  key(event, region) {
    if (event.key === "Escape") {
      this.start = this.drawn = null;
      if (region) this.send(null);
      return true;
    }
    if (event.key === "g" || event.key === "G") {
      this.send([0.35, 0.35, 0.65, 0.65]);
      return true;
    }
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (!step || !region) return false;
    const [dx, dy] = step.map((s) => s * 0.05);
    let [left, top, right, bottom] = region;
    if (event.shiftKey) {
      right = Math.min(1, Math.max(left + 0.05, right + dx));
      bottom = Math.min(1, Math.max(top + 0.05, bottom + dy));
    } else {
      const x = Math.min(1 - right, Math.max(-left, dx)), y = Math.min(1 - bottom, Math.max(-top, dy));
      [left, right, top, bottom] = [left + x, right + x, top + y, bottom + y];
    }
    this.send([left, top, right, bottom].map((part) => Math.min(1, Math.max(0, part))));
    return true;
  }
}
