"use strict";
// What is written over the scene: numbers and times at crossings, captions of views side by side.

class Labels {
  constructor(scene, data, crossings, spell) {
    this.scene = scene;
    this.runs = data.runs;
    this.spell = spell;
    this.many = data.runs.length > 1;
    this.pane = document.getElementById("pane");
    this.host = document.getElementById("labels");
    this.leaders = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    this.host.append(this.leaders);
    this.marks = scene.drawings.flatMap((drawing, run) => drawing.marks.map((mark) => {
      const label = this.element("mark");
      const members = mark.members.map((k) => crossings.find((c) => c.run === run && c.index === k));
      if (this.many) label.style.borderColor = RUN_COLOURS[run];
      return { ...mark, drawing, label, members, run };
    }));
    this.captions = scene.side_by_side ? data.runs.map((run) => this.element("caption", run.label)) : [];
    this.dividers = this.captions.slice(1).map(() => this.element("divider"));
  }

  element(kind, text = "") {
    const made = document.createElement("div");
    made.className = kind;
    made.textContent = text;
    this.host.append(made);
    return made;
  }

  // `now`: the crossing that is passed at present, or null.
  draw(shown, now) {
    const views = this.scene.views(), width = this.pane.clientWidth, height = this.pane.clientHeight;
    this.draw_captions(views, width, height);
    this.leaders.replaceChildren();
    const placed = [];
    for (const mark of this.marks) {
      mark.label.hidden = !shown;
      mark.ring.visible = shown;
      if (shown) placed.push(this.written(mark, now, views));
    }
    // Each label above its mark, then pushed clear of those already set, inside its own view.
    const boxes = this.obstacles();
    placed.sort((a, b) => a.y - b.y || a.x - b.x);
    for (const one of placed) this.put(one, boxes, height);
  }

  // A mark with its text, and where it belongs.
  written(mark, now, views) {
    const active = now !== null && mark.members.includes(now);
    const numbers = mark.members.map((c) => c.number);
    const some = numbers.length > 6 ? [...numbers.slice(0, 5), "…"] : numbers;
    const whose = this.many && !this.scene.side_by_side ? `${this.runs[mark.run].label}: ` : "";
    const text = active ? `${now.number}: ${whose}t = ${this.spell(now.time)} s\n${now.y}, ${now.kind}` : whose + some.join(" · ");
    if (mark.label.textContent !== text) mark.label.textContent = text;
    mark.label.classList.toggle("now", active);
    const tile = views.find((view) => view.shown.includes(mark.drawing));
    const at = this.scene.project(mark.at, tile), rim = this.scene.project(mark.rim, tile);
    const gap = 6 + Math.hypot(rim.x - at.x, rim.y - at.y);
    return { mark, tile, ...at, gap, w: mark.label.offsetWidth, h: mark.label.offsetHeight };
  }

  put({ mark, tile, x, y, gap, w, h }, boxes, height) {
    const low = tile.x + 4, top = height - tile.y - tile.h + 4;
    const left = Math.min(Math.max(x - w / 2, low), Math.max(low, tile.x + tile.w - w - 4));
    const options = [];
    for (let k = 0; k < 12; k++) options.push(y - gap - h - 4 * k, y + gap + 4 * k);
    const clear = (b) => b >= top && b + h <= top + tile.h - 8
      && boxes.every((o) => left >= o.x + o.w + 3 || left + w + 3 <= o.x || b >= o.y + o.h + 3 || b + h + 3 <= o.y);
    const b = options.find(clear);
    mark.label.style.visibility = b === undefined ? "hidden" : "visible";
    if (b === undefined) return;
    boxes.push({ x: left, y: b, w, h });
    mark.label.style.transform = `translate(${left}px, ${b}px)`;
    const line = document.createElementNS("http://www.w3.org/2000/svg", "line");
    const ends = { x1: x, y1: b > y ? y + gap - 6 : y - gap + 6, x2: Math.min(Math.max(x, left + 6), left + w - 6), y2: b > y ? b : b + h };
    for (const [name, value] of Object.entries(ends)) line.setAttribute(name, value);
    this.leaders.append(line);
  }

  obstacles() {
    const pane = this.pane.getBoundingClientRect();
    return [document.getElementById("view-buttons"), ...this.captions].map((element) => {
      const box = element.getBoundingClientRect();
      return { x: box.left - pane.left, y: box.top - pane.top, w: box.width, h: box.height };
    });
  }

  draw_captions(views, width, height) {
    this.captions.forEach((caption, i) => {
      const { x, y, w, h } = views[i], top = height - y - h;
      caption.style.left = `${x + 10}px`;
      caption.style.top = `${top + 8}px`;
      caption.style.color = RUN_COLOURS[i];
      if (i === 0) return;
      const wide = views[0].y === y;
      const box = wide ? [x, 0, 1, height] : [0, top, width, 1];
      ["left", "top", "width", "height"].forEach((name, k) => { this.dividers[i - 1].style[name] = `${box[k]}px`; });
    });
  }
}
