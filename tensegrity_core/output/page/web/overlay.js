// What is written over the picture: names, the force of a pull, flashes where strings change.

import { Vector3 } from "three";
import { css } from "./palette.js";

const FLASH = 0.7; // s of real time
const TALL = 7; // half the height of a name, pixels
const CROWD = 50; // names, of which those that are written stand APART pixels or more from each other
const APART = 12;
const SHARES = [0.5, 0.4, 0.6, 0.3, 0.7]; // of the way along what is named
const point = new Vector3();

export class Overlay {
  constructor(canvas, stage, structure, model) {
    Object.assign(this, { canvas, stage, structure, model });
    this.flashes = [];
    this.widths = new Map(); // of texts
  }

  // Mark a string for a moment; text: what became of it.
  flash(string, text, now) {
    this.flashes = this.flashes.filter((one) => one.string !== string);
    this.flashes.push({ string, text, since: now });
  }

  get busy() {
    return this.flashes.length > 0;
  }

  // names: 0 none, 1 nodes, 2 all; chosen: {kind, index} or null; pull: {node, target, force} or null
  draw(now, names, chosen, pull) {
    const { width, height } = this.stage;
    const empty = !(names || chosen || pull || this.flashes.length);
    if (this.canvas.hidden !== empty) this.canvas.hidden = empty; // a sheet that is not there costs nothing
    if (empty) return;
    const ratio = Math.min(2, window.devicePixelRatio || 1);
    if (this.canvas.width !== Math.round(width * ratio) || this.canvas.height !== Math.round(height * ratio)) {
      this.canvas.width = Math.round(width * ratio);
      this.canvas.height = Math.round(height * ratio);
    }
    const pen = this.canvas.getContext("2d", { willReadFrequently: this.stage.software }); // else software draws as a card would
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    this.#drawFlashes(pen, now);
    this.#drawNames(pen, names, chosen);
    if (pull) this.#drawPull(pen, pull);
  }

  // What is chosen first, then nodes, bars, strings; a name for which there is no room is left out, until one comes nearer.
  #drawNames(pen, names, chosen) {
    const { model } = this;
    const kinds = [
      ["node", model.nodeNames, (node) => [node], "600 13px", "--ink", 1],
      ["bar", model.barNames, (bar) => model.bars[bar], "italic 600 12px", "--ink", 2],
      ["string", model.stringNames, (string) => model.strings[string], "500 12px", "--ink-soft", 2],
    ];
    const count = kinds.reduce((sum, kind) => sum + (names >= kind[5] ? kind[1].length : 0), 0);
    this.room = count > CROWD ? APART : 1;
    this.taken = [];
    const write = ([, all, ends, font, colour], index, must) => {
      pen.font = `${font} system-ui, sans-serif`;
      this.#write(pen, all[index], ends(index), css(colour), must);
    };
    for (const kind of kinds) if (chosen?.kind === kind[0]) write(kind, chosen.index, true);
    for (const kind of kinds) {
      if (names < kind[5]) continue;
      kind[1].forEach((_, index) => chosen?.kind === kind[0] && chosen.index === index || write(kind, index, false));
    }
  }

  #middle([one, other]) {
    return this.structure.node(one, point).add(this.structure.node(other, other_)).multiplyScalar(0.5);
  }

  // Write with a halo beside one node, or beside the line between two; must: also where there is no room.
  #write(pen, text, ends, colour, must) {
    const wide = 0.5 * this.#width(pen, text) + 2;
    const seen = ends.map((node) => this.stage.project(this.structure.node(node, point)));
    const spots = seen.length > 1 ? besideLine(seen, wide) : besideNode(seen[0], wide);
    const spot = spots.find(([x, y]) => this.#free(x, y, wide)) ?? (must ? spots[0] : null);
    if (!spot) return;
    const [x, y] = spot;
    this.taken.push([x, y, wide]);
    pen.lineWidth = 4;
    pen.lineJoin = "round";
    pen.strokeStyle = css("--stage");
    pen.strokeText(text, x, y);
    pen.fillStyle = colour;
    pen.fillText(text, x, y);
  }

  #free(x, y, wide) {
    const { width, height } = this.stage;
    if (x < wide || x > width - wide || y < TALL || y > height - TALL) return false;
    const room = this.room;
    return !this.taken.some(([u, v, other]) => Math.abs(u - x) < wide + other + room && Math.abs(v - y) < 2 * TALL + room);
  }

  // Width of a text in the pen's font, pixels.
  #width(pen, text) {
    const key = pen.font + text;
    if (!this.widths.has(key)) this.widths.set(key, pen.measureText(text).width);
    return this.widths.get(key);
  }

  #drawPull(pen, pull) {
    const [x, y] = this.stage.project(this.structure.node(pull.node, point));
    const [u, v] = this.stage.project(point.set(...pull.target));
    pen.strokeStyle = pen.fillStyle = css("--force");
    pen.lineWidth = 2.5;
    pen.setLineDash([6, 4]);
    pen.beginPath();
    pen.moveTo(x, y);
    pen.lineTo(u, v);
    pen.stroke();
    pen.setLineDash([]);
    pen.beginPath();
    pen.arc(u, v, 6, 0, 2 * Math.PI);
    pen.fill();
    pen.font = "600 13px system-ui, sans-serif";
    pen.lineWidth = 4;
    pen.strokeStyle = css("--stage");
    const text = `${pull.force.toPrecision(3)} N`;
    const [left, top] = [Math.max(30, Math.min(this.stage.width - 30, u)), Math.max(12, Math.min(this.stage.height - 12, v - 18))];
    pen.strokeText(text, left, top);
    pen.fillText(text, left, top);
  }

  #drawFlashes(pen, now) {
    this.flashes = this.flashes.filter((one) => now - one.since < FLASH);
    for (const { string, text, since } of this.flashes) {
      const age = (now - since) / FLASH;
      const [x, y] = this.stage.project(this.#middle(this.model.strings[string]));
      pen.globalAlpha = 1 - age;
      pen.strokeStyle = css("--accent");
      pen.lineWidth = 2;
      pen.beginPath();
      pen.arc(x, y, 10 + 22 * age, 0, 2 * Math.PI);
      pen.stroke();
      pen.font = "600 12px system-ui, sans-serif";
      pen.lineWidth = 4;
      pen.strokeStyle = css("--stage");
      pen.strokeText(text, x, y - 22 - 10 * age);
      pen.fillStyle = css("--accent");
      pen.fillText(text, x, y - 22 - 10 * age);
      pen.globalAlpha = 1;
    }
  }
}

const other_ = new Vector3();

// Where a name may stand, the best place first: its middle, [x, y]; wide: half its width.
function besideNode([x, y], wide) {
  return [[x, y - 16], [x, y + 16], [x + wide + 9, y], [x - wide - 9, y]];
}

function besideLine([[x, y], [u, v]], wide) {
  const length = Math.hypot(u - x, v - y) || 1;
  const [across, up] = [(y - v) / length, (u - x) / length];
  const away = Math.abs(across) * wide + Math.abs(up) * TALL + 8;
  return SHARES.flatMap((share) => [1, -1].map((side) => [x + share * (u - x) + side * away * across, y + share * (v - y) + side * away * up]));
}
