"use strict";
// Where the points of a run are at any time.

function floats(base64) {
  const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
  return new Float32Array(bytes.buffer);
}

// Positions of a run's points at any time, between the stored pictures by Catmull and Rom's cubic.
class Motion {
  constructor(run) {
    this.values = floats(run.points);
    this.width = 3 * run.count;
    this.frames = run.frames;
    this.start = run.start;
    this.end = run.end;
    this.now = new Float32Array(this.width);
  }

  at(time) {
    const { values, width, frames, now } = this;
    const span = this.end - this.start;
    const place = span > 0 ? ((time - this.start) / span) * (frames - 1) : 0;
    const x = Math.min(Math.max(place, 0), frames - 1);
    const i = Math.min(Math.floor(x), Math.max(frames - 2, 0));
    const s = x - i, j = Math.min(i + 1, frames - 1);
    for (let k = 0; k < width; k++) {
      const b = values[i * width + k], c = values[j * width + k];
      const before = i > 0 ? values[(i - 1) * width + k] : 2 * b - c;
      const after = j + 1 < frames ? values[(j + 1) * width + k] : 2 * c - b;
      const mb = (c - before) / 2, mc = (after - b) / 2;
      const r = 1 - s;
      now[k] = b * r * r * (1 + 2 * s) + c * s * s * (3 - 2 * s) + mb * s * r * r - mc * s * s * r;
    }
    return now;
  }
}
