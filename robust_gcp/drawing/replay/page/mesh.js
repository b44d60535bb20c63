"use strict";
// Shapes of a robot's bodies, from its own meshes and primitives.

const PALEST = 0.72; // lightness of shapes, of 1

function shape_of(shape) {
  const up = (geometry) => geometry.rotateX(Math.PI / 2); // three.js builds along y, Pinocchio along z
  if (shape.kind === "box") return new THREE.BoxGeometry(...shape.size);
  if (shape.kind === "sphere") return new THREE.SphereGeometry(shape.radius, 32, 20);
  if (shape.kind === "cylinder") return up(new THREE.CylinderGeometry(shape.radius, shape.radius, shape.length, 32));
  if (shape.kind === "cone") return up(new THREE.CylinderGeometry(0, shape.radius, shape.length, 32));
  if (shape.kind === "capsule") {
    const profile = [];
    for (let i = 0; i <= 24; i++) {
      const angle = -Math.PI / 2 + (Math.PI * i) / 24;
      const end = i < 12 ? -shape.length / 2 : shape.length / 2;
      profile.push(new THREE.Vector2(shape.radius * Math.cos(angle), end + shape.radius * Math.sin(angle)));
    }
    return up(new THREE.LatheGeometry(profile, 32));
  }
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  const indexed = new THREE.BufferGeometry();
  indexed.setAttribute("position", new THREE.BufferAttribute(new Float32Array(bytes(shape.corners)), 3));
  indexed.setIndex(new THREE.BufferAttribute(new Uint32Array(bytes(shape.index)), 1));
  const geometry = indexed.toNonIndexed(); // flat facets: edges of machined parts stay edges
  geometry.computeVertexNormals();
  return geometry;
}

// A white robot would be lost on the pale ground.
function darken(colour) {
  const hsl = { h: 0, s: 0, l: 0 };
  colour.getHSL(hsl);
  if (hsl.l > PALEST) colour.setHSL(hsl.h, hsl.s, PALEST);
}

function mesh_of(mesh, tint) {
  const [red, green, blue, opacity] = mesh.colour;
  const colour = new THREE.Color(red, green, blue);
  darken(colour);
  if (tint !== null) colour.lerp(new THREE.Color(tint), 0.6);
  const material = new THREE.MeshStandardMaterial({
    color: colour, roughness: 0.8, metalness: 0, side: THREE.DoubleSide, transparent: opacity < 1, opacity,
  });
  const made = new THREE.Mesh(shape_of(mesh.shape), material);
  made.matrixAutoUpdate = false;
  made.geometry.computeBoundingBox();
  return { frame: mesh.frame, local: new THREE.Matrix4().fromArray(mesh.placement), made };
}

// The pose of a body from its origin and its points along x and y.
function pose_of(origin, on_x, on_y) {
  const x = on_x.sub(origin).normalize();
  const z = x.clone().cross(on_y.sub(origin)).normalize();
  return new THREE.Matrix4().makeBasis(x, z.clone().cross(x), z).setPosition(origin);
}

// Corners of the boxes around a run's shapes, where they are now.
function corners_of(meshes) {
  const found = [];
  for (const { made } of meshes) {
    const { min, max } = made.geometry.boundingBox;
    for (let i = 0; i < 8; i++) {
      const corner = new THREE.Vector3(i & 1 ? max.x : min.x, i & 2 ? max.y : min.y, i & 4 ? max.z : min.z);
      found.push(corner.applyMatrix4(made.matrix));
    }
  }
  return found;
}
