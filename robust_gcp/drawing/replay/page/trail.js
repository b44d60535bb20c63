"use strict";
// A line of constant width on the page along a path, drawn up to the present, paler where it is older.

const THREE = MeshCat.THREE;
const TRAIL_COLOURS = ["#c2185b", "#5b5ea6", "#00695c", "#8a5a00"];

const VERTEX = `
  attribute vec3 other; attribute vec2 side; uniform vec2 size; uniform float wide; varying float when;
  void main() {
    vec4 a = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
    vec4 b = projectionMatrix * modelViewMatrix * vec4(other, 1.0);
    vec2 along = (b.xy / b.w - a.xy / a.w) * size;
    vec2 normal = vec2(-along.y, along.x) / max(length(along), 1e-9);
    a.xy += normal * side.x * wide / size * a.w;
    when = side.y;
    gl_Position = a;
  }`;

const FRAGMENT = `
  uniform vec3 colour; uniform float now; uniform float fade; varying float when;
  void main() {
    if (when > now) discard;
    gl_FragColor = vec4(colour, mix(0.85, 0.3, clamp((now - when) / fade, 0.0, 1.0)));
  }`;

// `fine` points of the path make one picture; the uniform `now` counts pictures.
function ribbon(path, fine, colour) {
  const n = path.length - 1;
  const here = new Float32Array(12 * n), there = new Float32Array(12 * n), side = new Float32Array(8 * n);
  const index = [];
  for (let i = 0; i < n; i++) {
    for (let corner = 0; corner < 4; corner++) {
      const first = corner < 2 ? i : i + 1, second = corner < 2 ? i + 1 : i;
      path[first].toArray(here, 12 * i + 3 * corner);
      path[second].toArray(there, 12 * i + 3 * corner);
      side[8 * i + 2 * corner] = (corner % 2 ? 1 : -1) * (corner < 2 ? 1 : -1);
      side[8 * i + 2 * corner + 1] = first / fine;
    }
    index.push(4 * i, 4 * i + 1, 4 * i + 2, 4 * i + 2, 4 * i + 1, 4 * i + 3);
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(here, 3));
  geometry.setAttribute("other", new THREE.BufferAttribute(there, 3));
  geometry.setAttribute("side", new THREE.BufferAttribute(side, 2));
  geometry.setIndex(index);
  const material = new THREE.ShaderMaterial({
    transparent: true, depthWrite: false, side: THREE.DoubleSide, vertexShader: VERTEX, fragmentShader: FRAGMENT,
    uniforms: {
      colour: { value: new THREE.Color(colour) }, size: { value: new THREE.Vector2(1, 1) },
      now: { value: 0 }, fade: { value: 30 }, wide: { value: 3 },
    },
  });
  const mesh = new THREE.Mesh(geometry, material);
  mesh.frustumCulled = false;
  return mesh;
}
