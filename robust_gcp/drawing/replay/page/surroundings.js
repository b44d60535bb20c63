"use strict";
// What stands around the motion: a grid on the ground, a scale, a camera that follows; and a recording of it.

class Surroundings {
  constructor(scene) {
    this.scene = scene;
    this.last = null; // where the middle of the motion was when the camera followed it last
    this.grid = this.ground();
    scene.viewer.scene.add(this.grid);
  }

  // Lines at round distances: of a spatial motion on its lowest level, of a planar one in its plane, behind.
  ground() {
    const { scene } = this;
    const flat = scene.drawings.every((drawing) => drawing.flat);
    const normal = (flat ? scene.view : scene.up).clone().normalize();
    const across_it = (flat ? scene.up : scene.view).clone().projectOnPlane(normal).normalize();
    const axes = [across_it, normal.clone().cross(across_it)];
    const low = scene.cloud.map((p) => p.dot(normal)).reduce((a, b) => Math.min(a, b), Infinity);
    const spans = axes.map((axis) => {
      const seen = scene.cloud.map((p) => p.dot(axis));
      return [seen.reduce((a, b) => Math.min(a, b), Infinity), seen.reduce((a, b) => Math.max(a, b), -Infinity)];
    });
    const size = Math.max(...spans.map(([from, to]) => to - from)) || 1;
    this.step = round_length(size / 8);
    const r = Math.max(...scene.drawings.map((d) => d.r));
    const level = normal.clone().multiplyScalar(low - (flat ? 8 : 1.5) * r);
    const ends = spans.map(([from, to]) => [Math.floor(from / this.step) - 1, Math.ceil(to / this.step) + 1]);
    const points = [];
    const at = (i, j) => level.clone().addScaledVector(axes[0], i * this.step).addScaledVector(axes[1], j * this.step);
    for (let i = ends[0][0]; i <= ends[0][1]; i++) points.push(at(i, ends[1][0]), at(i, ends[1][1]));
    for (let j = ends[1][0]; j <= ends[1][1]; j++) points.push(at(ends[0][0], j), at(ends[0][1], j));
    const lines = new THREE.BufferGeometry().setFromPoints(points);
    const paint = new THREE.LineBasicMaterial({ color: "#b6c0ca", transparent: true, opacity: 0.7 });
    return new THREE.LineSegments(lines, paint);
  }

  // A round length that is 60 to 160 px long where the camera looks, and these px.
  scale() {
    const { scene } = this;
    const distance = scene.camera.position.distanceTo(scene.viewer.controls.target);
    const metre = scene.views()[0].h / (2 * distance * Math.tan((scene.camera.fov * Math.PI) / 360));
    const length = round_length(60 / metre);
    return { length, width: length * metre };
  }

  // The camera goes with the middle of the first motion.
  follow(on) {
    const { now, width } = this.scene.drawings[0].motion, seen = 3 * this.scene.drawings[0].run.seen;
    const middle = new THREE.Vector3();
    for (let k = 0; k < Math.min(seen, width); k += 3) middle.add(new THREE.Vector3().fromArray(now, k));
    middle.divideScalar(Math.max(1, seen / 3));
    if (on && this.last !== null) {
      const moved = middle.clone().sub(this.last);
      this.scene.camera.position.add(moved);
      this.scene.viewer.controls.target.add(moved);
    }
    this.last = middle;
  }
}

// The least of 1, 2 and 5 · 10ⁿ that is not below a length.
function round_length(least) {
  const power = Math.pow(10, Math.floor(Math.log10(least)));
  return [1, 2, 5, 10].map((k) => k * power).find((length) => length >= least * (1 - 1e-12));
}

// The canvas as a .webm file, from now on until `stop` is called; null where the browser makes none.
function recording(canvas, name) {
  if (!window.MediaRecorder || !canvas.captureStream) return null;
  const parts = [], recorder = new MediaRecorder(canvas.captureStream(30), { mimeType: "video/webm" });
  const begun = new Promise((resolve) => {
    recorder.addEventListener("dataavailable", (event) => {
      parts.push(event.data);
      if (event.data.size > 0) resolve();
    });
    setTimeout(resolve, 20000);
  });
  const done = new Promise((resolve) => {
    recorder.addEventListener("stop", () => resolve(new Blob(parts, { type: "video/webm" })));
  });
  recorder.start(100);
  return {
    async stop() {
      await begun; // stopped before its first picture is encoded the film would be empty
      recorder.stop();
      const link = document.createElement("a");
      const made = await done;
      link.href = URL.createObjectURL(made);
      link.download = name;
      link.click();
      return made.size;
    },
  };
}
