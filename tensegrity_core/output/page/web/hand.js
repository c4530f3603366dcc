// Pointers on the picture: a click chooses a node, a string or a bar; a drag that begins at a free node pulls it.

import { Vector3 } from "three";

const NEAR = { mouse: 16, touch: 30, pen: 20 }; // pixels
const CLICK = 5; // pixels that a click may move

export class Hand {
  // told: {choose(what), pull(node, target), release()}; target: [x, y, z] m
  constructor(canvas, stage, structure, model, told) {
    Object.assign(this, { canvas, stage, structure, model, told });
    this.pulled = null;
    canvas.addEventListener("pointerdown", (event) => this.#down(event), { capture: true });
    window.addEventListener("pointermove", (event) => this.#move(event)); // also beside the picture, where a drag may end
    for (const name of ["pointerup", "pointercancel"]) window.addEventListener(name, (event) => this.#up(event, name));
  }

  #place(event) {
    const frame = this.canvas.getBoundingClientRect();
    return [event.clientX - frame.left, event.clientY - frame.top];
  }

  #down(event) {
    if (event.button > 0 || this.pulled) return;
    const [x, y] = this.#place(event);
    this.from = [x, y];
    const node = this.#nearest(x, y, NEAR[event.pointerType] ?? NEAR.mouse, this.model.free);
    if (node === null || !this.told.pull) return;
    this.stage.controls.enabled = false;
    this.canvas.setPointerCapture(event.pointerId);
    this.pulled = { node, pointer: event.pointerId };
  }

  #move(event) {
    const [x, y] = this.#place(event);
    if (this.pulled?.pointer === event.pointerId) {
      const target = this.stage.unproject(x, y, this.structure.node(this.pulled.node, new Vector3()));
      this.told.pull(this.pulled.node, target.toArray());
      return;
    }
    if (event.pointerType === "mouse" && !event.buttons) {
      const near = this.#nearest(x, y, NEAR.mouse, this.model.free) !== null;
      this.canvas.style.cursor = near && this.told.pull ? "grab" : "";
    }
  }

  #up(event, name) {
    const [x, y] = this.#place(event);
    const still = this.from && Math.hypot(x - this.from[0], y - this.from[1]) < CLICK && name === "pointerup";
    if (!this.from) return;
    this.from = null;
    if (this.pulled?.pointer === event.pointerId) {
      this.pulled = null;
      this.stage.controls.enabled = true;
      this.told.release();
    }
    if (still) this.told.choose(this.#under(x, y, NEAR[event.pointerType] ?? NEAR.mouse));
  }

  // The node of a list that is nearest to a place on the canvas, null: none is near.
  #nearest(x, y, near, nodes) {
    let found = null;
    for (const node of nodes) {
      const [u, v] = this.stage.project(this.structure.node(node, new Vector3()));
      const distance = Math.hypot(u - x, v - y);
      if (distance < near) [near, found] = [distance, node];
    }
    return found;
  }

  // What is there: a node before a string before a bar, null: nothing.
  #under(x, y, near) {
    const node = this.#nearest(x, y, near, this.model.nodes.keys());
    if (node !== null) return { kind: "node", index: node };
    for (const [kind, list] of [["string", this.model.paths], ["bar", this.model.bars]]) {
      let found = null;
      let least = 0.6 * near;
      list.forEach((path, index) => {
        const seen = path.map((node) => this.stage.project(this.structure.node(node, new Vector3())));
        for (let at = 0; at + 1 < seen.length; at++) {
          const [[u, v], [s, t]] = [seen[at], seen[at + 1]];
          const along = Math.max(0, Math.min(1, ((x - u) * (s - u) + (y - v) * (t - v)) / ((s - u) ** 2 + (t - v) ** 2 || 1)));
          const distance = Math.hypot(u + along * (s - u) - x, v + along * (t - v) - y);
          if (distance < least) [least, found] = [distance, index];
        }
      });
      if (found !== null) return { kind, index: found };
    }
    return null;
  }
}
