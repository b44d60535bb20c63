"use strict";
// Play, pause, scrub, speed; keys; the address's fragment.

(() => {
  const $ = (id) => document.getElementById(id);
  const data = JSON.parse($("data").textContent);
  if (document.createElement("canvas").getContext("webgl") === null) {
    throw new Error("This browser cannot draw the motion: WebGL is missing or switched off.");
  }
  const scene = new Scene($("pane"), data);
  const around = new Surroundings(scene);
  const picture = data.speed / 30; // simulated seconds from one picture to the next
  const span = data.end - data.start;
  const digits = span > 0 ? Math.min(9, Math.max(2, 3 + Math.ceil(-Math.log10(span)))) : 3;
  const state = { time: data.start, playing: false, speed: data.speed, last: null };
  const many = data.runs.length > 1;
  const spell = (time) => time.toFixed(digits).replace("-", "−");

  // ------------------------------------------------------------------ crossings

  const crossings = data.runs
    .flatMap((run, i) => run.crossings.map((crossing, k) => ({ ...crossing, run: i, index: k })))
    .sort((a, b) => a.time - b.time);
  crossings.forEach((crossing, i) => { crossing.number = i + 1; });
  const labels = new Labels(scene, data, crossings, spell);

  function nearest() {
    let best = null;
    for (const c of crossings) {
      const away = Math.abs(c.time - state.time);
      if (away <= 8 * picture && (best === null || away < Math.abs(best.time - state.time))) best = c;
    }
    return best;
  }

  function list_crossings() {
    $("crossings").hidden = crossings.length === 0;
    for (const c of crossings) {
      const item = document.createElement("li"), button = document.createElement("button");
      const about = document.createElement("small");
      button.textContent = `${c.number} · t = ${spell(c.time)} s`;
      about.textContent = `${c.y}, ${c.kind}` + (many ? `, ${data.runs[c.run].label}` : "");
      button.append(about);
      button.addEventListener("click", () => { pause(); seek(c.time); });
      item.append(button);
      $("crossing-list").append(item);
      c.button = button;
    }
  }

  function draw_ticks() {
    const ticks = $("ticks"), width = ticks.clientWidth;
    ticks.replaceChildren();
    let free = -Infinity;
    for (const c of crossings) {
      const x = span > 0 ? ((c.time - data.start) / span) * width : 0;
      const tick = document.createElement("span");
      tick.style.left = `${x}px`;
      if (many) tick.style.background = RUN_COLOURS[c.run];
      ticks.append(tick);
      const half = 5 + 4 * String(c.number).length;
      if (x - half < free) continue;
      const name = document.createElement("b");
      name.textContent = c.number;
      name.style.left = `${x}px`;
      ticks.append(name);
      free = x + half;
    }
  }

  function draw_legend() {
    data.runs.forEach((run, i) => {
      const item = document.createElement("li"), swatch = document.createElement("i");
      swatch.style.background = RUN_COLOURS[i];
      item.append(...(many ? [swatch] : []), run.label);
      if (run.end < data.end) item.append(`, until t = ${spell(run.end)} s`);
      $("legend").append(item);
    });
    if (data.runs.every((run) => run.stops.length === 0)) return;
    const item = document.createElement("li"), ring = document.createElement("i");
    ring.className = "stop";
    item.append(ring, "joint at its stop");
    $("legend").append(item);
  }

  // ------------------------------------------------------------------ time

  function seek(time) {
    state.time = Math.min(Math.max(time, data.start), data.end);
    scene.place(state.time);
    around.follow($("follow").checked);
  }

  function show_scale() {
    const { length, width } = around.scale();
    $("scale").firstElementChild.style.width = `${width}px`;
    $("scale").lastElementChild.textContent = length >= 1 ? `${length} m` : length >= 1e-3
      ? `${Number((1e3 * length).toPrecision(3))} mm` : `${length.toExponential(0)} m`;
  }

  function show_time() {
    const now = nearest();
    $("time").value = state.time;
    $("time").setAttribute("aria-valuetext", `${spell(state.time)} s of ${spell(data.end)} s`);
    $("clock").innerHTML = `t = ${spell(state.time)} s <small>of ${spell(data.end)} s</small>`;
    for (const c of crossings) c.button.setAttribute("aria-current", String(c === now));
    document.body.dataset.time = state.time;
    document.body.dataset.state = state.playing ? "playing" : "paused";
  }

  function play() {
    if (state.time >= data.end) seek(data.start);
    state.playing = true;
    state.last = null;
    $("play").textContent = "Pause";
    scene.dirty = true;
  }

  function pause() {
    state.playing = false;
    $("play").textContent = "Play";
    scene.dirty = true;
  }

  function tick(now) {
    requestAnimationFrame(tick);
    if (state.playing) {
      const passed = state.last === null ? 0 : Math.min(now - state.last, 500) / 1000;
      state.last = now;
      seek(state.time + passed * state.speed);
      if (state.time >= data.end) {
        if ($("loop").checked && span > 0) seek(data.start);
        else pause();
      }
    }
    if (!scene.dirty) return;
    scene.draw();
    show_scale();
    labels.draw($("show-labels").checked, nearest());
    show_time();
  }

  // ------------------------------------------------------------------ controls

  function show() {
    for (const drawing of scene.drawings) {
      drawing.show_meshes(drawing.meshes.length > 0 && $("show-meshes").checked);
      drawing.ghost.visible = $("show-ghost").checked;
      for (const trail of drawing.trails) trail.visible = $("show-trails").checked;
    }
    around.grid.visible = $("show-grid").checked;
    scene.dirty = true;
  }

  // Plays the motion once, at its speed, into a file.
  async function record() {
    $("loop").checked = false;
    seek(data.start);
    const film = recording(scene.viewer.renderer.domElement, `${document.title.split(" – ")[0]}.webm`);
    play();
    while (state.playing) await new Promise((done) => requestAnimationFrame(done));
    return film.stop();
  }

  function hop(sign) {
    pause();
    const near = picture / 100;
    const ahead = crossings.filter((c) => sign * (c.time - state.time) > near);
    if (ahead.length) seek(ahead[sign > 0 ? 0 : ahead.length - 1].time);
  }

  const step = (count) => { pause(); seek(state.time + count * picture); };
  const keys = {
    " ": () => (state.playing ? pause() : play()),
    ArrowLeft: (event) => step(event.shiftKey ? -30 : -1),
    ArrowRight: (event) => step(event.shiftKey ? 30 : 1),
    Home: () => { pause(); seek(data.start); },
    End: () => { pause(); seek(data.end); },
    n: () => hop(1), p: () => hop(-1), r: () => scene.fit(),
    "+": () => scene.zoom(0.8), "=": () => scene.zoom(0.8), "-": () => scene.zoom(1.25),
  };
  document.addEventListener("keydown", (event) => {
    const action = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    const at = event.target;
    const own = at.tagName === "SELECT" || (event.key === " " && (at.tagName === "BUTTON" || at.type === "checkbox"
      || at.tagName === "SUMMARY"));
    if (!action || own || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    action(event);
  });
  $("play").addEventListener("click", () => keys[" "]());
  $("step-back").addEventListener("click", () => step(-1));
  $("step-on").addEventListener("click", () => step(1));
  $("zoom-in").addEventListener("click", () => scene.zoom(0.8));
  $("zoom-out").addEventListener("click", () => scene.zoom(1.25));
  $("reset").addEventListener("click", () => scene.fit());
  $("record").addEventListener("click", record);
  $("time").addEventListener("input", () => { pause(); seek(Number($("time").value)); });
  $("speed").addEventListener("change", () => { state.speed = Number($("speed").value); });
  for (const box of ["show-trails", "show-ghost", "show-labels", "show-meshes", "show-grid"]) $(box).addEventListener("change", show);
  new ResizeObserver(() => { scene.resize(); draw_ticks(); }).observe($("pane"));

  function follow_fragment() {
    const asked = new URLSearchParams(location.hash.slice(1));
    if (asked.has("t") && Number.isFinite(Number(asked.get("t")))) seek(Number(asked.get("t")));
    if (asked.has("paused")) pause();
    return asked.has("paused");
  }
  window.addEventListener("hashchange", follow_fragment);

  for (const times of [0.05, 0.1, 0.25, 0.5, 1, 2, 5]) {
    const option = document.createElement("option");
    option.value = times * data.speed;
    option.textContent = `${Number((times * data.speed).toPrecision(6))}×`;
    option.selected = times === 1;
    $("speed").append(option);
  }
  $("time").min = data.start;
  $("time").max = data.end;
  $("record").hidden = !window.MediaRecorder || !scene.viewer.renderer.domElement.captureStream;
  $("show-grid").checked = !scene.drawings.every((drawing) => drawing.flat);
  $("show-meshes").parentElement.hidden = data.runs.every((run) => run.meshes.length === 0);
  show();
  draw_legend();
  list_crossings();
  draw_ticks();
  seek(data.start);
  const still = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
  if (!follow_fragment() && !still && span > 0) play();
  requestAnimationFrame(tick);

  // For scripts and the browser's console.
  window.replay = { play, pause, seek, scene, around, record, time: () => state.time };
})();
