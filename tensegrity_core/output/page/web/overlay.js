// What is written over the picture: names, the force of a pull, flashes where strings change.

import { Vector3 } from "three";
import { css } from "./palette.js";

const FLASH = 0.7; // s of real time
const point = new Vector3();

export class Overlay {
  constructor(canvas, stage, structure, model) {
    Object.assign(this, { canvas, stage, structure, model });
    this.flashes = [];
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

  #drawNames(pen, names, chosen) {
    const { model } = this;
    const wanted = (kind, index) => names > (kind === "node" ? 0 : 1) || (chosen?.kind === kind && chosen.index === index);
    const taken = [];
    model.nodeNames.forEach((name, node) => {
      if (wanted("node", node)) this.#write(pen, name, this.structure.node(node, point), "600 13px", css("--ink"), 16, taken);
    });
    model.stringNames.forEach((name, string) => {
      if (wanted("string", string)) this.#write(pen, name, this.#middle(model.strings[string]), "500 12px", css("--ink-soft"), 0, taken);
    });
    model.barNames.forEach((name, bar) => {
      if (wanted("bar", bar)) this.#write(pen, name, this.#middle(model.bars[bar]), "italic 600 12px", css("--ink"), 0, taken);
    });
  }

  #middle([one, other]) {
    return this.structure.node(one, point).add(this.structure.node(other, other_)).multiplyScalar(0.5);
  }

  // Write with a halo, above a point by so many pixels; beside it where something is written already.
  #write(pen, text, at, font, colour, above, taken) {
    let [x, y] = this.stage.project(at);
    y -= above;
    for (let i = 0; i < 3 && taken.some(([u, v]) => Math.abs(u - x) < 20 && Math.abs(v - y) < 13); i++) y += 14;
    taken.push([x, y]);
    pen.font = `${font} system-ui, sans-serif`;
    pen.lineWidth = 4;
    pen.lineJoin = "round";
    pen.strokeStyle = css("--stage");
    pen.strokeText(text, x, y);
    pen.fillStyle = colour;
    pen.fillText(text, x, y);
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
