"use strict";
// meshcat's viewer with our bodies in it: light, camera, framing, several motions in one picture.

class Scene {
  constructor(pane, data) {
    this.pane = pane;
    this.data = data;
    this.viewer = new MeshCat.Viewer(pane, false);
    this.viewer.gui.domElement.remove();
    this.viewer.hide_background();
    for (const part of ["Grid", "Axes", "Lights"]) this.viewer.delete_path([part]);
    this.viewer.scene.rotation.set(0, 0, 0); // meshcat turns z up by turning the scene; our camera knows its up
    this.viewer.set_3d_pane_size = () => this.resize();
    this.viewer.set_dirty = () => { this.dirty = true; };
    this.view = new THREE.Vector3(...data.view);
    this.up = new THREE.Vector3(...data.up);
    this.side_by_side = data.layout === "side by side";
    let depth = 0;
    this.drawings = data.runs.map((run, i) => {
      const again = !this.side_by_side && data.runs.slice(0, i).some((other) => same_start(other, run));
      const drawing = new Drawing(run, i, data.runs.length > 1, this.view, depth, !again);
      if (!this.side_by_side) depth += drawing.height;
      this.viewer.scene.add(drawing.group);
      return drawing;
    });
    const flat = data.runs.every((run) => run.layers !== null);
    this.camera = new THREE.PerspectiveCamera(flat ? 10 : 24, 1, 0.01, 100);
    this.camera.up.copy(this.up);
    this.camera.position.copy(this.view);
    this.viewer.controls.dispose();
    this.viewer.set_camera(this.camera);
    this.viewer.controls.addEventListener("start", () => { this.touched = true; });
    this.light();
    this.cloud = this.drawings.flatMap((drawing) => cloud_of(drawing));
    this.touched = false;
    this.resize();
  }

  light() {
    const from_above = new THREE.HemisphereLight(0xffffff, 0xb9c2cc, 0.75);
    from_above.position.copy(this.up);
    const lamp = new THREE.DirectionalLight(0xffffff, 0.45);
    const right = this.up.clone().cross(this.view);
    lamp.position.copy(this.view).addScaledVector(this.up, 0.8).addScaledVector(right, -0.5);
    this.viewer.scene.add(from_above, lamp);
  }

  // One rectangle (x, y from the bottom, width, height) for each motion, px.
  views() {
    const w = this.pane.clientWidth, h = this.pane.clientHeight, n = this.drawings.length;
    if (!this.side_by_side) return [{ x: 0, y: 0, w, h, shown: this.drawings }];
    return this.drawings.map((drawing, i) => (w >= h
      ? { x: (i * w) / n, y: 0, w: w / n, h, shown: [drawing] }
      : { x: 0, y: h - ((i + 1) * h) / n, w, h: h / n, shown: [drawing] }));
  }

  resize() {
    const w = this.pane.clientWidth, h = this.pane.clientHeight;
    if (w === 0 || h === 0) return;
    this.viewer.renderer.setPixelRatio(window.devicePixelRatio);
    this.viewer.renderer.setSize(w, h);
    const tile = this.views()[0];
    this.camera.aspect = tile.w / tile.h;
    this.camera.updateProjectionMatrix();
    for (const drawing of this.drawings) {
      for (const trail of drawing.trails) trail.material.uniforms.size.value.set(tile.w, tile.h);
    }
    if (!this.touched) this.fit();
    this.dirty = true;
  }

  // All of the motion inside the picture: the nearest camera that sees every point, with a margin.
  fit() {
    const z = this.view.clone().normalize();
    const x = this.up.clone().cross(z).normalize(), y = z.clone().cross(x);
    const seen = this.cloud.map((p) => [p.dot(x), p.dot(y), p.dot(z)]);
    const middle = [0, 1, 2].map((k) => {
      const values = seen.map((p) => p[k]);
      return (values.reduce((a, b) => Math.min(a, b)) + values.reduce((a, b) => Math.max(a, b))) / 2;
    });
    const r = Math.max(...this.drawings.map((d) => d.r));
    const tile = this.views()[0];
    const tan = Math.tan((this.camera.fov * Math.PI) / 360);
    const room_y = Math.max(0.5, 1 - 76 / tile.h), room_x = Math.max(0.5, 1 - 40 / tile.w);
    let distance = 6 * r;
    for (const p of seen) {
      const [a, b, c] = p.map((value, k) => value - middle[k]);
      distance = Math.max(distance, c + (Math.abs(a) + 2 * r) / (tan * this.camera.aspect * room_x),
        c + (Math.abs(b) + 2 * r) / (tan * room_y));
    }
    const target = x.multiplyScalar(middle[0]).addScaledVector(y, middle[1]).addScaledVector(z, middle[2]);
    this.viewer.controls.target.copy(target);
    this.camera.position.copy(target).addScaledVector(z, distance);
    this.camera.near = distance / 25;
    this.camera.far = distance * 50;
    this.camera.updateProjectionMatrix();
    this.viewer.controls.update();
    this.touched = false;
    this.dirty = true;
  }

  zoom(factor) {
    this.touched = true;
    const target = this.viewer.controls.target;
    this.camera.position.sub(target).multiplyScalar(factor).add(target);
    this.viewer.controls.update();
    this.dirty = true;
  }

  place(time) {
    for (const drawing of this.drawings) drawing.place(Math.min(Math.max(time, drawing.motion.start), drawing.motion.end));
    this.dirty = true;
  }

  draw() {
    const { renderer, scene, controls } = this.viewer;
    controls.update();
    renderer.setScissorTest(true);
    for (const { x, y, w, h, shown } of this.views()) {
      renderer.setViewport(x, y, w, h);
      renderer.setScissor(x, y, w, h);
      for (const drawing of this.drawings) drawing.group.visible = shown.includes(drawing);
      renderer.render(scene, this.camera);
    }
    this.dirty = false;
  }

  // Where a point of the scene is in the pane, px from its top left.
  project(point, tile) {
    const p = point.clone().project(this.camera);
    return {
      x: tile.x + ((p.x + 1) / 2) * tile.w,
      y: this.pane.clientHeight - tile.y - ((p.y + 1) / 2) * tile.h,
    };
  }
}

// A ghost over another one would only darken it.
function same_start(one, other) {
  const chars = Math.floor((12 * Math.min(one.count, other.count) * 4) / 3);
  return one.count === other.count && one.points.slice(0, chars) === other.points.slice(0, chars);
}

// Points that the picture must hold: of the whole motion, thinned where it is long.
function cloud_of(drawing) {
  const { values, width, frames, start, end } = drawing.motion, seen = 3 * drawing.run.seen;
  const stride = Math.max(1, Math.ceil((frames * seen) / 3 / 40000));
  const found = [];
  for (let i = 0; i < frames; i += stride) {
    for (let k = 0; k < seen; k += 3) {
      found.push(new THREE.Vector3().fromArray(values, i * width + k));
    }
  }
  for (let i = 0; i <= 40 && drawing.meshes.length; i++) {
    drawing.place(start + ((end - start) * i) / 40);
    found.push(...corners_of(drawing.meshes));
  }
  return found;
}
