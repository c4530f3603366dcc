// Bars, strings, nodes and arrows in space, drawn from a frame.
//
// A taut string is a straight tube that is the wider and the further along the colour scale the more it bears; a slack one is
// dashed and sags by its spare length.  An NSH string has a row of cells, one for each beam: an open hexagon, which fills and
// stretches when the beam has snapped.  A string over several nodes is drawn segment by segment, its cells on the longest one.

import {
  CircleGeometry, ConeGeometry, CylinderGeometry, DoubleSide, DynamicDrawUsage, FrontSide, Group, InstancedMesh, Matrix4, MeshBasicMaterial,
  MeshLambertMaterial, Quaternion, RingGeometry, SphereGeometry, Vector3,
} from "three";
import { css, tensionColor } from "./palette.js";
import { FOOT } from "./stage.js";

const DASHES = 9; // of a slack string
const UP = new Vector3(0, 1, 0);

export class Structure {
  constructor(stage, model) {
    this.stage = stage;
    this.model = model;
    this.group = new Group();
    stage.scene.add(this.group);
    const beams = model.honeycombs.reduce((sum, honeycomb) => sum + honeycomb.beams, 0);
    const rod = new CylinderGeometry(1, 1, 1, 12, 1);
    const thin = new CylinderGeometry(1, 1, 1, 6, 1);
    this.bars = this.#mesh("bar", rod, "--bar", model.bars.length);
    const segments = model.paths.reduce((sum, path) => sum + path.length - 1, 0);
    this.strings = this.#mesh("tube", thin, null, segments * (DASHES + 2));
    this.nodes = this.#mesh("ball", new SphereGeometry(1, 14, 10), "--bar", model.nodes.length);
    this.feet = this.#mesh("cone", new ConeGeometry(1, 1, model.planar ? 3 : 4), "--support", model.nodes.length);
    this.shadows = this.#mesh("shadow", rod, "--shadow", model.floor === null || model.planar ? 0 : model.bars.length, true);
    this.open = this.#mesh("ring", new RingGeometry(0.66, 1, 6), null, beams, true);
    this.full = this.#mesh("disc", new CircleGeometry(1, 6), null, beams, true);
    this.shafts = this.#mesh("tube", thin, "--force", 2 * model.nodes.length + 1, true);
    this.heads = this.#mesh("cone", new ConeGeometry(1, 1, 10), "--force", 2 * model.nodes.length + 1, true);
    this.thick = 0.018 * model.member;
    this.largest = 0; // tension at the end of the colour scale, N
    this.places = new Float64Array(3 * model.nodes.length);
    this.recolour();
  }

  // kind: of its parts, for flat.js
  #mesh(kind, geometry, colour, count, flat = false) {
    const Material = flat ? MeshBasicMaterial : MeshLambertMaterial;
    const mesh = new InstancedMesh(geometry, new Material({ side: flat ? DoubleSide : FrontSide }), Math.max(1, count));
    mesh.instanceMatrix.setUsage(DynamicDrawUsage);
    mesh.frustumCulled = false;
    mesh.kind = kind;
    mesh.colour = colour;
    mesh.count = 0;
    this.group.add(mesh);
    return mesh;
  }

  recolour() {
    for (const mesh of this.group.children) if (mesh.colour) mesh.material.color.set(css(mesh.colour));
  }

  node(index, out = new Vector3()) {
    return out.fromArray(this.places, 3 * index);
  }

  // frame: see model.js; shown: {forces, reactions, pulled, chosen, snapped, arrowScale}; snapped: per honeycomb which beams are;
  // pulled: a node whose force is not drawn; arrowScale: m/N.
  update(frame, shown) {
    const model = this.model;
    model.positions(frame, this.places);
    for (const mesh of this.group.children) mesh.count = 0;
    this.tension = model.of(frame, "string_force");
    this.elastic = model.of(frame, "elastic_force");
    this.lengths = model.of(frame, "string_length");
    this.#drawBars();
    model.paths.forEach((path, string) => this.#drawString(string, path, shown));
    model.nodes.forEach((_, node) => this.#drawNode(node, shown.chosen));
    this.#drawArrows(frame, shown);
    for (const mesh of this.group.children) {
      mesh.instanceMatrix.needsUpdate = true;
      if (mesh.instanceColor) mesh.instanceColor.needsUpdate = true;
    }
  }

  #drawBars() {
    this.model.bars.forEach(([one, other]) => {
      tube(this.bars, this.node(one, a), this.node(other, b), this.thick);
      if (this.model.floor === null || this.model.planar) return;
      a.z = b.z = this.model.floor + 2e-4 * this.model.size;
      tube(this.shadows, a, b, this.thick);
      flatten(this.shadows, a.z);
    });
  }

  #drawNode(node, chosen) {
    this.node(node, a);
    const wide = this.thick * (chosen?.kind === "node" && chosen.index === node ? 1.9 : 1.25);
    put(this.nodes, matrix.makeScale(wide, wide, wide).setPosition(a));
    if (!this.model.fixed[node]) return;
    const tall = FOOT * this.model.member;
    turn.setFromUnitVectors(UP, this.stage.camera.up);
    const lift = this.model.planar ? -0.5 : 0.5; // in space a foot stands on the ground that its node lies on
    put(this.feet, matrix.compose(b.copy(a).addScaledVector(this.stage.camera.up, lift * tall), turn, c.set(tall * 0.8, tall, tall * 0.8)));
  }

  #drawString(string, path, shown) {
    const share = this.largest > 0 ? this.tension[string] / this.largest : 0;
    const chosen = shown.chosen?.kind === "string" && shown.chosen.index === string;
    const wide = this.thick * (0.24 + 0.36 * Math.max(0, Math.min(1, share))) * (chosen ? 1.7 : 1);
    const colour = tensionColor(share);
    const slack = this.elastic[string] <= 0 && this.tension[string] <= 0 && !this.model.twoWay[string];
    const honeycomb = this.model.nshOf.get(string);
    for (let at = 0; at + 1 < path.length; at++) {
      this.node(path[at], a);
      this.node(path[at + 1], b);
      if (honeycomb !== undefined && at === this.model.cellsOn[string].segment) {
        this.#drawCells(string, wide, colour, shown.snapped[honeycomb], slack);
      } else if (slack) this.#drawSlack(string, wide, colour);
      else coloured(tube(this.strings, a, b, wide), colour);
    }
  }

  // How far the string from a to b hangs down, m, by its part of the spare length; `down` is where to.
  #sag(string) {
    const length = a.distanceTo(b);
    const spare = Math.max(0, this.restLengths[string] - this.lengths[string]) * (length / (this.lengths[string] || 1));
    this.#sagging(down);
    return Math.max(0.03 * length, Math.min(0.3 * length, Math.sqrt(0.375 * (length + spare) * spare)));
  }

  // The point at a share of the way from a to b, of a string that hangs so deep.
  #along(share, deep, out) {
    out.lerpVectors(a, b, share).addScaledVector(down, 4 * deep * share * (1 - share));
    if (deep && out.z < (this.model.floor ?? -Infinity)) out.z = this.model.floor;
    return out;
  }

  // Dashes of a slack string, between two shares of the way.
  #drawSlack(string, wide, colour, deep = this.#sag(string), from = 0, to = 1) {
    const dashes = Math.max(2, Math.round(DASHES * (to - from)));
    const step = (to - from) / (2 * dashes - 1);
    for (let i = 0; i < dashes; i++) {
      this.#along(from + 2 * i * step, deep, e);
      this.#along(from + (2 * i + 1) * step, deep, f);
      coloured(tube(this.strings, e, f, wide), colour);
    }
  }

  // Unit vector across the string from a to b, downwards where there is a down.
  #sagging(out) {
    d.subVectors(b, a).normalize();
    for (const [x, y, z] of [[0, 0, -1], [1, 0, 0], [0, 1, 0]]) {
      if (this.model.planar && [x, y, z][this.model.outOfPlane]) continue;
      out.set(x, y, z).addScaledVector(d, -d.dot(out.set(x, y, z)));
      if (out.length() > 0.1) return out.normalize();
    }
    return out.set(0, 0, -1);
  }

  #drawCells(string, wide, colour, snapped, slack) {
    const size = this.model.member;
    const length = a.distanceTo(b) || 1e-9;
    const longer = this.lengths[string] - this.model.startLengths[string]; // of the whole way
    const beams = snapped.length;
    const roomy = Math.max(0.25 * this.model.cellsOn[string].start, Math.min(0.06 * beams, 0.3) * size) + longer;
    const row = Math.min(0.9 * length, Math.max(0.1 * length, roomy));
    d.subVectors(b, a).divideScalar(length);
    const weights = snapped.map((one) => (one ? 1.55 : 1));
    const unit = row / weights.reduce((sum, one) => sum + one, 0);
    const tall = Math.min(0.032 * size, 1.1 * unit);
    const deep = slack ? this.#sag(string) : 0;
    const first = 0.5 * (1 - row / length);
    this.#line(string, 0, first, wide, colour, deep);
    this.#line(string, 1 - first, 1, wide, colour, deep);
    d.subVectors(b, a).divideScalar(length);
    across.subVectors(this.stage.camera.position, this.#along(0.5, deep, c));
    if (this.stage.camera.isOrthographicCamera) across.subVectors(this.stage.camera.position, this.stage.controls.target);
    across.addScaledVector(d, -across.dot(d)).normalize();
    side.crossVectors(across, d);
    let reached = first * length;
    snapped.forEach((one, beam) => {
      const long = unit * weights[beam];
      this.#along((reached + 0.5 * long) / length, deep, e).addScaledVector(across, 0.4 * this.thick);
      matrix.makeBasis(f.copy(d).multiplyScalar(0.5 * long), g.copy(side).multiplyScalar(one ? 0.62 * tall : tall), across);
      const mesh = one ? this.full : this.open;
      coloured(put(mesh, matrix.setPosition(e)), colour);
      reached += long;
    });
  }

  // A part of an NSH string beside its cells, between two shares of the way.
  #line(string, from, to, wide, colour, deep) {
    if (deep) this.#drawSlack(string, wide, colour, deep, from, to);
    else coloured(tube(this.strings, this.#along(from, 0, e), this.#along(to, 0, f), wide), colour);
  }

  #drawArrows(frame, shown) {
    const model = this.model;
    const scale = shown.arrowScale;
    if (shown.forces && frame.force) {
      model.vectors(frame.force, model.free, (node, x, y, z) => {
        if (node !== shown.pulled) this.#arrow(this.node(node, a), b.set(x, y, z).multiplyScalar(scale), false);
      });
    }
    if (shown.reactions) {
      model.vectors(model.of(frame, "reaction"), model.grounded, (node, x, y, z) => {
        b.set(x, y, z).multiplyScalar(scale);
        const apart = (1.2 * FOOT * model.member) / (b.length() || 1); // its tip shows beside the foot
        this.#arrow(this.node(node, a).addScaledVector(b, -1 - apart), b, true);
      });
    }
  }

  #arrow(from, along, thin) {
    const length = along.length();
    if (length < 0.01 * this.model.size || !Number.isFinite(length)) return;
    const wide = this.thick * (thin ? 0.3 : 0.5);
    const head = Math.min(0.5 * length, 5 * wide);
    d.copy(along).divideScalar(length);
    e.copy(from).addScaledVector(d, length - head);
    tube(this.shafts, from, e, wide);
    turn.setFromUnitVectors(UP, d);
    put(this.heads, matrix.compose(e.addScaledVector(d, 0.5 * head), turn, f.set(2.4 * wide, head, 2.4 * wide)));
  }
}

const [a, b, c, d, e, f, g, across, side, down] = Array.from({ length: 10 }, () => new Vector3());
const middle = new Vector3();
const along = new Vector3();
const wide = new Vector3();
const matrix = new Matrix4();
const turn = new Quaternion();

function put(mesh, transform) {
  mesh.setMatrixAt(mesh.count, transform);
  mesh.count++;
  return mesh;
}

function coloured(mesh, colour) {
  mesh.setColorAt(mesh.count - 1, colour);
}

function tube(mesh, from, to, radius) {
  along.subVectors(to, from);
  const length = along.length() || 1e-9;
  turn.setFromUnitVectors(UP, along.divideScalar(length));
  middle.addVectors(from, to).multiplyScalar(0.5);
  return put(mesh, matrix.compose(middle, turn, wide.set(radius, length, radius)));
}

// Press what was put last flat onto a height.
function flatten(mesh, height) {
  mesh.getMatrixAt(mesh.count - 1, matrix);
  for (const row of [2, 6, 10]) matrix.elements[row] *= 1e-3;
  matrix.elements[14] = height;
  mesh.setMatrixAt(mesh.count - 1, matrix);
}
