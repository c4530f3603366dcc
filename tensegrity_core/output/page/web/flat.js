// Draws a scene of three.js on a plain canvas, where no graphics card draws it: what is farther away first.
//
// It knows the kinds of parts that a structure has, see `kind` of the meshes in structure.js, and lines and a disc of the ground.

import { Color, Matrix4, Vector3 } from "three";

const PIECES = { bar: 6, tube: 3 }; // into which a long part is cut, each with a distance of its own
const HALO = 1.6; // pixels around a bar in the colour of the background, so that crossings show what is in front

export class FlatRenderer {
  constructor({ canvas }) {
    this.canvas = canvas;
    this.pen = canvas.getContext("2d", { willReadFrequently: true });
    this.ratio = 1;
  }

  setPixelRatio(ratio) {
    this.ratio = ratio;
  }

  setSize(width, height) {
    [this.width, this.height] = [width, height];
    this.canvas.width = Math.round(width * this.ratio);
    this.canvas.height = Math.round(height * this.ratio);
  }

  render(scene, camera) {
    const { pen } = this;
    scene.updateMatrixWorld();
    camera.updateMatrixWorld();
    this.camera = camera;
    this.whole = whole.multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse);
    pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    this.background = scene.background.getStyle();
    pen.fillStyle = this.background;
    pen.fillRect(0, 0, this.width, this.height);
    pen.lineJoin = "round";
    const parts = [];
    scene.traverseVisible((object) => {
      if (object.isInstancedMesh) this.#collect(object, parts);
      else if (object.isLineSegments) this.#drawLines(object);
      else if (object.isMesh) this.#drawDisc(object);
    });
    parts.sort((one, other) => other.far - one.far).forEach((part) => part.draw());
  }

  // Where a point is: {x, y} on the canvas, far: its distance along the line of sight, per: pixels per metre there.
  #see(point) {
    const far = -eye.copy(point).applyMatrix4(this.camera.matrixWorldInverse).z;
    const scale = 0.5 * this.height * this.camera.projectionMatrix.elements[5];
    eye.copy(point).applyMatrix4(this.whole);
    const per = this.camera.isOrthographicCamera ? scale : scale / Math.max(far, 1e-9);
    return { x: 0.5 * (1 + eye.x) * this.width, y: 0.5 * (1 - eye.y) * this.height, far, per };
  }

  #collect(mesh, parts) {
    const usual = mesh.material.color.getStyle();
    for (let i = 0; i < mesh.count; i++) {
      mesh.getMatrixAt(i, turned);
      turned.extractBasis(wide, tall, deep);
      centre.setFromMatrixPosition(turned);
      if (this.#see(centre).far < this.camera.near) continue;
      const colour = mesh.instanceColor ? shade.fromArray(mesh.instanceColor.array, 3 * i).getStyle() : usual;
      this[`_${mesh.kind}`](parts, colour);
    }
  }

  #add(parts, far, draw) {
    parts.push({ far, draw });
  }

  // A tube along `tall`, cut into pieces.
  #cut(parts, colour, pieces, halo) {
    const radius = wide.length();
    let last = this.#see(eye2.copy(centre).addScaledVector(tall, -0.5));
    for (let i = 1; i <= pieces; i++) {
      const next = this.#see(eye2.copy(centre).addScaledVector(tall, i / pieces - 0.5));
      const [from, width] = [last, radius * (last.per + next.per)];
      this.#add(parts, 0.5 * (last.far + next.far), () => {
        if (halo) this.#stroke(from, next, width + 2 * HALO, this.background, "butt");
        this.#stroke(from, beyond(from, next), width, colour, "butt");
        if (halo) this.#stroke(from, next, 0.3 * width, "rgb(255 255 255 / 0.16)", "butt");
      });
      last = next;
    }
  }

  #stroke(from, to, width, colour, cap) {
    const { pen } = this;
    pen.strokeStyle = colour;
    pen.lineWidth = Math.max(0.8, width);
    pen.lineCap = cap;
    pen.beginPath();
    pen.moveTo(from.x, from.y);
    pen.lineTo(to.x, to.y);
    pen.stroke();
  }

  _bar(parts, colour) {
    this.#cut(parts, colour, PIECES.bar, true);
  }

  _tube(parts, colour) {
    this.#cut(parts, colour, PIECES.tube, false);
  }

  _shadow(parts, colour) {
    const [from, to] = [-0.5, 0.5].map((share) => this.#see(eye2.copy(centre).addScaledVector(tall, share)));
    const width = wide.length() * (from.per + to.per);
    this.#add(parts, Infinity, () => this.#stroke(from, to, 0.8 * width, colour, "round"));
  }

  _ball(parts, colour) {
    const at = this.#see(centre);
    const radius = wide.length() * at.per;
    this.#add(parts, at.far - wide.length(), () => {
      this.pen.fillStyle = colour;
      this.pen.beginPath();
      this.pen.arc(at.x, at.y, radius, 0, 2 * Math.PI);
      this.pen.fill();
    });
  }

  _cone(parts, colour) {
    const [base, tip] = [-0.5, 0.5].map((share) => this.#see(eye2.copy(centre).addScaledVector(tall, share)));
    const radius = wide.length() * base.per;
    const length = Math.hypot(tip.x - base.x, tip.y - base.y) || 1;
    const [across, up] = [(-(tip.y - base.y) / length) * radius, ((tip.x - base.x) / length) * radius];
    this.#add(parts, base.far - wide.length(), () => this.#polygon([[base.x + across, base.y + up], [tip.x, tip.y], [base.x - across, base.y - up]], colour));
  }

  _ring(parts, colour) {
    const points = this.#hexagon(0.83);
    const at = this.#see(centre);
    const width = 0.3 * Math.min(wide.length(), tall.length()) * at.per;
    this.#add(parts, at.far, () => {
      this.pen.strokeStyle = colour;
      this.pen.lineWidth = Math.max(1.2, width);
      this.#trace(points);
      this.pen.stroke();
    });
  }

  _disc(parts, colour) {
    const points = this.#hexagon(1);
    this.#add(parts, this.#see(centre).far, () => this.#polygon(points, colour));
  }

  #hexagon(size) {
    return Array.from({ length: 6 }, (_, i) => {
      const angle = (i * Math.PI) / 3;
      eye2.copy(centre).addScaledVector(wide, size * Math.cos(angle)).addScaledVector(tall, size * Math.sin(angle));
      const { x, y } = this.#see(eye2);
      return [x, y];
    });
  }

  #polygon(points, colour) {
    this.pen.fillStyle = colour;
    this.#trace(points);
    this.pen.fill();
  }

  #trace(points) {
    this.pen.beginPath();
    points.forEach(([x, y], i) => (i ? this.pen.lineTo(x, y) : this.pen.moveTo(x, y)));
    this.pen.closePath();
  }

  // Of the ground; it lies behind all else.
  #drawLines(object) {
    const { array } = object.geometry.attributes.position;
    this.pen.strokeStyle = object.material.color.getStyle();
    this.pen.lineWidth = 1;
    this.pen.beginPath();
    for (let i = 0; i < array.length; i += 6) {
      const [from, to] = [i, i + 3].map((at) => this.#see(eye2.fromArray(array, at).applyMatrix4(object.matrixWorld)));
      if (Math.min(from.far, to.far) < this.camera.near) continue;
      this.pen.moveTo(from.x, from.y);
      this.pen.lineTo(to.x, to.y);
    }
    this.pen.stroke();
  }

  #drawDisc(object) {
    const { array } = object.geometry.attributes.position;
    const points = [];
    for (let i = 3; i < array.length; i += 3) {
      const at = this.#see(eye2.fromArray(array, i).applyMatrix4(object.matrixWorld));
      if (at.far < this.camera.near) return;
      points.push([at.x, at.y]);
    }
    this.#polygon(points, object.material.color.getStyle());
  }
}

// A little further than the end of a piece, so that no gap shows before the next.
function beyond(from, to) {
  const length = Math.hypot(to.x - from.x, to.y - from.y) || 1;
  return { x: to.x + (0.7 * (to.x - from.x)) / length, y: to.y + (0.7 * (to.y - from.y)) / length };
}

const [eye, eye2, centre, wide, tall, deep] = Array.from({ length: 6 }, () => new Vector3());
const shade = new Color();
const whole = new Matrix4();
const turned = new Matrix4();
