// A simulation that runs in the page, under what a hand does to it.

import { Kernel } from "./kernel.js";
import { Record } from "./record.js";

const SLICE = 1 / 240; // s between communication points
const RECORDED = 1 / 60; // s between frames that are kept
const STATE_EVERY = 6; // frames between saved states

export class Live {
  constructor(model, module, packed) {
    this.model = model;
    this.kernel = new Kernel(module, packed, model.fields, model.integers);
    this.scene = this.kernel.values.slice(); // inputs and parameters as the scene has them
    this.record = new Record();
    this.pull = null; // {node, target: [x, y, z]}: a spring from a node to a place
    this.given = Float64Array.from(this.kernel.field("force"), (_, i) => model.force[i] ?? 0);
    this.held = this.given.slice(); // constant forces, N
    this.failure = null;
    this.goal = { rest_length: this.kernel.field("rest_length").slice() };
    this.#choosePull();
    this.restart();
  }

  // Where the scene starts, under the present parameters; everything: with the scene's parameters, too.
  restart(everything = false) {
    const kernel = this.kernel;
    if (everything) {
      const options = ["method", "tolerance", "max_step"].map((name) => [name, kernel.field(name)[0]]);
      kernel.reset();
      for (const [name, value] of options) kernel.field(name)[0] = value;
      this.goal.rest_length = kernel.field("rest_length").slice();
      this.held.set(this.given);
    }
    const inputs = ["force", "node_position", "node_velocity", "node_acceleration", "rest_length_rate"];
    for (const name of inputs) kernel.field(name).set(this.scene.subarray(...this.model.fields[name]));
    kernel.field("rest_length").set(this.goal.rest_length);
    kernel.field("force").set(this.held);
    this.record.clear();
    this.failure = null;
    this.#try(() => kernel.initialize(0));
    this.#keep();
    this.owed = 0;
  }

  // Set parameters that hold for a whole run; it starts anew.
  choose(options) {
    for (const [name, value] of Object.entries(options)) this.kernel.field(name)[0] = value;
    this.restart();
  }

  // Set a parameter of all its components, or of one.
  tune(name, place, value) {
    const field = name in this.goal ? this.goal[name] : this.kernel.field(name);
    if (place === null) field.set(value);
    else field[place] = value;
  }

  get time() {
    return this.record.end;
  }

  // Go back to a recorded instant, the last that has a saved state, and forget what came after it.
  rewind(time) {
    let index = this.record.at(time);
    while (index > 0 && !this.record.states[index]) index--;
    const state = this.record.states[index];
    if (!state) return;
    this.kernel.restore(state);
    this.record.cut(index + 1);
    this.goal.rest_length = this.kernel.field("rest_length").slice();
    this.failure = null;
    this.owed = 0;
  }

  // Advance by so much time, s, unless the work takes longer than the budget, ms; returns how far it came.
  advance(duration, budget) {
    const start = this.time;
    const deadline = performance.now() + budget;
    this.owed += duration;
    const slice = this.slice;
    while (this.owed >= 0.5 * slice && !this.failure) {
      this.owed -= slice;
      this.#step(slice);
      if (performance.now() > deadline) this.owed = Math.min(this.owed, 0);
    }
    return this.time - start;
  }

  // Communication step, s; a fixed step of an integrator is not cut by it.
  get slice() {
    const method = this.model.methods[this.kernel.field("method")[0]][0];
    const fixed = method === "rk4" || method === "ros2" ? this.kernel.field("max_step")[0] : 0;
    return fixed > SLICE ? fixed : SLICE;
  }

  #step(h) {
    const kernel = this.kernel;
    this.#pull(h);
    this.#wind(h);
    if (!this.#try(() => kernel.step(h))) return;
    this.#carry(h);
    if (kernel.transitionCount) this.record.transitions.push(...kernel.transitions);
    if (kernel.time - this.#kept >= RECORDED - 1e-9) this.#keep();
  }

  #kept = 0;
  #count = 0;

  #keep() {
    const kernel = this.kernel;
    const values = kernel.values.slice(this.model.firstOutput);
    const force = kernel.field("force").slice();
    const frame = { time: kernel.time, values, snapped: kernel.field("snapped").slice(), force };
    const first = this.record.frames.length === 0;
    const state = first || this.#count++ % STATE_EVERY === 0 ? kernel.save() : null;
    this.record.put(frame, state);
    this.#kept = kernel.time;
  }

  #try(call) {
    try {
      call();
      return true;
    } catch (error) {
      const message = error.field ? `${this.#nameOf(error)} ${error.message}` : error.message;
      this.failure = { status: error.status ?? "error", message, time: this.kernel.time };
      return false;
    }
  }

  // Of a value that the kernel refuses, and the value: s1.rest_length = 0.01.
  #nameOf({ field, place }) {
    const values = this.kernel.field(field);
    const names = this.model.stringNames;
    const name = values.length === names.length ? `${names[place]}.${field}` : field;
    return `${name} = ${Number(values[place].toPrecision(6))}`;
  }

  // Force on the free nodes: what is held, and a spring with a damper to the place that a node is pulled to.
  #pull(h) {
    const force = this.kernel.field("force");
    force.set(this.held);
    if (!this.pull) return;
    const { axes, free, fields } = this.model;
    const place = free.indexOf(this.pull.node);
    const position = this.kernel.values.subarray(...fields.position);
    const velocity = this.kernel.values.subarray(...fields.velocity);
    const stiffness = this.stiffness * this.strength;
    axes.forEach((axis, i) => {
      const away = this.pull.target[axis] - position[axes.length * this.pull.node + i];
      const rate = velocity[axes.length * place + i];
      force[axes.length * place + i] += stiffness * (away - rate * (h + 0.02));
    });
  }

  // A hand's spring: stretched by a quarter of the structure it pulls as hard as the structure weighs or is tensioned.
  #choosePull() {
    const kernel = this.kernel;
    this.strength = 1;
    kernel.initialize(0);
    const tension = Math.max(0, ...kernel.field("string_force"));
    const gravity = Math.hypot(...kernel.field("gravity")) || 9.81;
    const mass = [...kernel.field("bar_mass"), ...kernel.field("point_mass"), ...kernel.field("string_mass")].reduce((sum, one) => sum + one, 0);
    const maximum = Math.max(0, ...kernel.field("nsh_Q")) * 4;
    this.stiffness = (4 * Math.max(tension, mass * gravity, maximum)) / this.model.size;
  }

  // Rest lengths move to where they were set, so that dampers see them move.
  #wind(h) {
    const length = this.kernel.field("rest_length");
    const rate = this.kernel.field("rest_length_rate");
    const fastest = 0.25 * this.model.size;
    this.goal.rest_length.forEach((goal, i) => {
      rate[i] = Math.max(-fastest, Math.min(fastest, (goal - length[i]) / h));
    });
  }

  // Inputs that have their rates among the inputs go on with them.
  #carry(h) {
    const kernel = this.kernel;
    const length = kernel.field("rest_length");
    const rate = kernel.field("rest_length_rate");
    for (let i = 0; i < length.length; i++) {
      length[i] = Math.abs(this.goal.rest_length[i] - length[i]) <= Math.abs(rate[i] * h) ? this.goal.rest_length[i] : length[i] + rate[i] * h;
    }
    const [position, velocity, acceleration] = ["position", "velocity", "acceleration"].map((n) => kernel.field(`node_${n}`));
    for (let i = 0; i < position.length; i++) {
      position[i] += velocity[i] * h + 0.5 * acceleration[i] * h * h;
      velocity[i] += acceleration[i] * h;
    }
  }
}
