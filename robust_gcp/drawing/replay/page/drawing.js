"use strict";
// The bodies of one motion: bars, pins, faces, trails, the ghost of the start, marks at crossings.
const BODY_COLOURS = ["#0072b2", "#d9822b", "#009e73", "#a8508b", "#3f8fc4", "#8a7a00", "#b5442e", "#5b5ea6"];
const RUN_COLOURS = ["#0b5cad", "#d1600a", "#00805a", "#8c3f75"];
const GROUND = "#8a939c", PIN = "#20262d", MARK = "#b58900", STOP = "#d7301f";
const BALL = new THREE.SphereGeometry(1, 20, 14);
const ROD = new THREE.CylinderGeometry(1, 1, 1, 20);
const PLATE = new THREE.BoxGeometry(2, 1, 2);
const DISC = new THREE.CylinderGeometry(1, 1, 2, 28).rotateX(Math.PI / 2);

// A direction across another one: the given normal, or whichever axis is far from it made normal.
function across(along, normal) {
  if (normal !== null) return normal.clone();
  const found = new THREE.Vector3(1, 0, 0).cross(along);
  return (found.lengthSq() > 0.1 ? found : new THREE.Vector3(0, 1, 0).cross(along)).normalize();
}

class Drawing {
  constructor(run, number, many, normal, depth, with_ghost) {
    this.run = run;
    this.motion = new Motion(run);
    this.group = new THREE.Group();
    this.sticks = new THREE.Group();
    this.bare = new THREE.Group(); // sticks of bodies that no shape shows
    this.shapes = new THREE.Group();
    this.normal = normal.clone();
    this.flat = run.layers !== null;
    this.r = run.radius;
    this.thick = 0.12 * this.r; // half the thickness of a bar of a planar linkage
    this.depth = depth; // of the backmost layer
    this.colour = many ? RUN_COLOURS[number] : null;
    this.mine = many ? new THREE.Color(RUN_COLOURS[number]) : new THREE.Color("#6b7280");
    this.bars = [];
    this.ghost_bars = [];
    this.blocks = [];
    this.ghost_blocks = [];
    this.ghost = new THREE.Group();
    this.ghost_sticks = new THREE.Group();
    this.build(with_ghost);
  }

  get height() {
    return this.flat ? (Math.max(...this.run.layers) + 2) * 2.4 * this.thick : 0;
  }

  level(body) {
    return this.flat ? this.depth + (this.run.layers[body] + (body > 0 ? 1 : 0)) * 2.4 * this.thick : 0;
  }

  width(body) {
    if (body === 0) return 0.5 * this.r;
    return this.flat ? this.r * Math.max(0.55, Math.pow(0.8, this.run.layers[body])) : this.r * 0.8;
  }

  body_colour(body) {
    if (body === 0) return new THREE.Color(GROUND);
    if (this.colour === null) return new THREE.Color(BODY_COLOURS[(body - 1) % BODY_COLOURS.length]);
    const hsl = { h: 0, s: 0, l: 0 };
    const made = new THREE.Color(this.colour);
    made.getHSL(hsl);
    return made.setHSL(hsl.h, hsl.s, Math.min(0.72, hsl.l + 0.1 * ((body - 1) % 3)));
  }

  material(colour, opacity) {
    const clear = opacity < 1;
    return new THREE.MeshStandardMaterial({
      color: colour, roughness: 0.75, metalness: 0, transparent: clear, opacity, depthWrite: !clear,
    });
  }

  build(with_ghost) {
    const run = this.run, ghost = this.ghost;
    const pale = new THREE.MeshBasicMaterial({
      color: this.mine, transparent: true, opacity: 0.2, depthWrite: false, side: THREE.DoubleSide,
      stencilWrite: true, stencilFunc: THREE.EqualStencilFunc, stencilRef: 0, stencilZPass: THREE.IncrementStencilOp,
    });
    const materials = {};
    const of = (body) => (run.bare.includes(body) ? this.bare : this.sticks);
    const start = (body) => (run.bare.includes(body) ? ghost : this.ghost_sticks);
    ghost.add(this.ghost_sticks);
    const paint = (body) => (materials[body] = materials[body] || this.material(this.body_colour(body), 1));
    for (const [a, b, body] of run.links) {
      this.bars.push(this.bar(a, b, body, this.width(body), paint(body), of(body)));
      if (with_ghost && body > 0) this.ghost_bars.push(this.bar(a, b, body, this.width(body), pale, start(body)));
    }
    for (const [a, b, body] of run.slides) {
      this.bars.push(this.bar(a, b, body, 0.5 * this.width(body), paint(body), of(body)));
      if (with_ghost) this.ghost_bars.push(this.bar(a, b, body, 0.5 * this.width(body), pale, start(body)));
    }
    for (const [a, b, slider, body] of run.rails) {
      this.bars.push(this.bar(a, b, 0, 0.35 * this.r, paint(0), this.sticks));
      this.blocks.push(this.block(a, b, slider, body, paint(body), of(body)));
      if (with_ghost) this.ghost_blocks.push(this.block(a, b, slider, body, pale, start(body)));
    }
    this.faces = run.faces.map(([corners, body]) => this.face(corners, body));
    this.pins = run.pins.map(([at, tip, ground]) => this.pin(at, tip, ground));
    this.meshes = run.meshes.map((mesh) => mesh_of(mesh, this.colour));
    for (const { made } of this.meshes) this.shapes.add(made);
    this.group.add(this.sticks, this.bare, this.shapes);
    this.show_meshes(this.meshes.length > 0);
    this.stops = (run.stops || []).map((stop) => this.stop(stop));
    this.trails = run.trails.map((trail, i) => this.trail(trail.point, i));
    this.place(run.start);
    this.pose(this.ghost_bars);
    this.pose_blocks(this.ghost_blocks);
    this.group.add(ghost);
    if (this.flat) ghost.position.copy(this.normal).multiplyScalar(-this.depth - 6 * this.thick);
    this.marks = this.places().map((place) => this.mark(place));
  }

  bar(a, b, body, r, material, group) {
    const parts = [new THREE.Mesh(this.flat ? PLATE : ROD, material)];
    for (let i = 0; i < 2; i++) parts.push(new THREE.Mesh(this.flat ? DISC : BALL, material));
    parts.forEach((part) => { part.matrixAutoUpdate = false; group.add(part); });
    return { a, b, body, r, parts };
  }

  block(a, b, slider, body, material, group) {
    const mesh = new THREE.Mesh(PLATE, material);
    mesh.matrixAutoUpdate = false;
    group.add(mesh);
    return { a, b, slider, body, mesh };
  }

  face(corners, body) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(3 * corners.length), 3));
    const index = [];
    for (let i = 2; i < corners.length; i++) index.push(0, i - 1, i);
    geometry.setIndex(index);
    const material = new THREE.MeshBasicMaterial({
      color: this.body_colour(body), transparent: true, opacity: body ? 0.25 : 0.1, side: THREE.DoubleSide,
      depthWrite: false,
    });
    const mesh = new THREE.Mesh(geometry, material);
    mesh.frustumCulled = false;
    (this.run.bare.includes(body) ? this.bare : this.sticks).add(mesh);
    return { corners, body, mesh };
  }

  pin(at, tip, ground) {
    const parts = [];
    const add = (geometry, colour) => {
      const mesh = new THREE.Mesh(geometry, this.material(new THREE.Color(colour), 1));
      mesh.matrixAutoUpdate = false;
      this.sticks.add(mesh);
      parts.push(mesh);
    };
    if (this.flat) {
      add(DISC, PIN);
      add(DISC, "#ffffff");
      if (ground) add(DISC, GROUND);
    } else {
      add(tip === at ? BALL : ROD, ground ? "#5d6670" : PIN);
    }
    return { at, tip, ground, parts };
  }

  trail(point, number) {
    const { frames, start, end } = this.motion;
    const fine = frames > 2000 ? 1 : 4; // segments for one picture's step
    const n = Math.max(frames - 1, 0) * fine, lift = this.flat ? -4 * this.thick : 0;
    const path = [];
    for (let i = 0; i <= n; i++) {
      const now = this.motion.at(n ? start + ((end - start) * i) / n : start);
      path.push(new THREE.Vector3().fromArray(now, 3 * point).addScaledVector(this.normal, lift));
    }
    const mesh = ribbon(path, fine, this.colour || TRAIL_COLOURS[number % TRAIL_COLOURS.length]);
    this.group.add(mesh);
    return mesh;
  }

  // A ring about a joint, to be seen while it is at its stop.
  stop({ point, times }) {
    const ring = new THREE.Mesh(
      new THREE.TorusGeometry(1.45 * this.r, 0.33 * this.r, 12, 40), this.material(new THREE.Color(STOP), 1));
    ring.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), this.normal);
    this.group.add(ring);
    return { point, times, ring };
  }

  // Crossings at one place share a mark.
  places() {
    const found = [];
    this.run.crossings.forEach((crossing, i) => {
      const at = new THREE.Vector3(...crossing.place);
      const same = found.find((place) => place.at.distanceTo(at) < 2 * this.r);
      if (same) same.members.push(i);
      else found.push({ at, members: [i] });
    });
    return found;
  }

  mark(place) {
    const ring = new THREE.Mesh(
      new THREE.TorusGeometry(1.9 * this.r, 0.2 * this.r, 12, 48), this.material(new THREE.Color(MARK), 1));
    ring.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), this.normal);
    ring.position.copy(place.at).addScaledVector(this.normal, this.flat ? this.depth + this.height : 0);
    this.group.add(ring);
    const rim = ring.position.clone().add(new THREE.Vector3(2.1 * this.r, 0, 0).applyQuaternion(ring.quaternion));
    return { ...place, ring, rim, at: ring.position.clone() };
  }

  show_meshes(shown) {
    this.shapes.visible = shown;
    this.sticks.visible = !shown;
    this.ghost_sticks.visible = !shown;
  }

  point(i, body = -1) {
    const now = this.motion.now, lift = body < 0 ? 0 : this.level(body);
    return new THREE.Vector3(now[3 * i], now[3 * i + 1], now[3 * i + 2]).addScaledVector(this.normal, lift);
  }

  pose(bars) {
    const matrix = new THREE.Matrix4();
    for (const { a, b, body, r, parts } of bars) {
      const p = this.point(a, body), q = this.point(b, body);
      const along = q.clone().sub(p), length = along.length();
      if (length > 0) along.divideScalar(length);
      else along.set(0, 0, 1);
      const z = across(along, this.flat ? this.normal : null);
      const x = along.clone().cross(z).normalize(), h = this.flat ? this.thick : r;
      const set = (part, at, stretch) => {
        matrix.makeBasis(x.clone().multiplyScalar(r), along.clone().multiplyScalar(stretch), z.clone().multiplyScalar(h));
        part.matrix.copy(matrix.setPosition(at));
      };
      set(parts[0], p.clone().add(q).multiplyScalar(0.5), Math.max(length, 1e-9));
      set(parts[1], p, r);
      set(parts[2], q, r);
    }
  }

  pose_blocks(blocks) {
    for (const { a, b, slider, body, mesh } of blocks) {
      const along = this.point(b).sub(this.point(a)).normalize();
      const z = across(along, this.flat ? this.normal : null), x = along.clone().cross(z).normalize();
      const h = this.flat ? this.thick : 1.5 * this.r;
      mesh.matrix.makeBasis(x.multiplyScalar(1.5 * this.r), along.multiplyScalar(5 * this.r), z.multiplyScalar(h));
      mesh.matrix.setPosition(this.point(slider, body));
    }
  }

  place(time) {
    this.motion.at(time);
    this.pose(this.bars);
    this.pose_blocks(this.blocks);
    for (const { corners, body, mesh } of this.faces) {
      const position = mesh.geometry.attributes.position;
      corners.forEach((i, k) => position.setXYZ(k, ...this.point(i, body).toArray()));
      position.needsUpdate = true;
    }
    for (const { at, tip, ground, parts } of this.pins) {
      const p = this.point(at);
      if (this.flat) {
        const front = this.depth + this.height;
        const disc = (mesh, r, from, to) => {
          const middle = p.clone().addScaledVector(this.normal, (from + to) / 2);
          mesh.matrix.compose(middle, new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 0, 1), this.normal),
            new THREE.Vector3(r, r, (to - from) / 2));
        };
        disc(parts[0], 0.5 * this.r, this.depth, front);
        disc(parts[1], 0.3 * this.r, front, front + 0.1 * this.thick);
        if (ground) disc(parts[2], 1.5 * this.r, this.depth - 2.5 * this.thick, this.depth - 1.2 * this.thick);
      } else if (tip === at) {
        parts[0].matrix.makeScale(1.25 * this.r, 1.25 * this.r, 1.25 * this.r).setPosition(p);
      } else {
        const axis = this.point(tip).sub(p).normalize();
        parts[0].matrix.compose(p, new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 1, 0), axis),
          new THREE.Vector3(1.15 * this.r, 4 * this.r, 1.15 * this.r));
      }
    }
    for (const { frame, local, made } of this.meshes) {
      made.matrix.multiplyMatrices(pose_of(this.point(frame), this.point(frame + 1), this.point(frame + 2)), local);
    }
    for (const { point, times, ring } of this.stops) {
      ring.visible = times.some(([first, last]) => first <= time && time <= last);
      ring.position.copy(this.point(point)).addScaledVector(this.normal, this.flat ? this.depth + this.height : 0);
    }
    const span = this.motion.end - this.motion.start;
    const frame = span > 0 ? ((time - this.motion.start) / span) * (this.motion.frames - 1) : 0;
    for (const mesh of this.trails) mesh.material.uniforms.now.value = frame;
  }
}
