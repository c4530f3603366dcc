// What stands beside the picture: curves, energies, what can be changed, what is chosen, transitions.

import { element, slider } from "./element.js";
import { short } from "./plots.js";

const ENERGIES = ["kinetic", "potential", "elastic", "dissipated", "input_work"];
const WORDS = { kinetic: "kinetic", potential: "potential", elastic: "in strings", dissipated: "dissipated", input_work: "work of inputs" };
const FACTORS = [
  ["rest_length", "Rest lengths", 0.9, 1.1],
  ["stiffness", "Stiffness", 0.1, 10],
  ["damping", "Damping", 0.01, 10],
  ["gravity", "Gravity", 0, 3],
];

export class Panel {
  // app: see main.js; live is null where a run is played back
  constructor(app) {
    this.app = app;
    this.model = app.model;
    const find = (id) => document.getElementById(id);
    this.parts = { energies: find("energies"), change: find("change"), chosen: find("chosen"), events: find("events"), method: find("method") };
    this.#energies();
    if (app.live) {
      this.#method();
      this.#change();
    } else {
      for (const name of ["change", "method"]) this.parts[name].hidden = true;
    }
    const { run } = this.model;
    if (run?.every > 1) this.work.textContent = `shown: one in ${run.every} of the run's ${run.instants} instants`;
    this.choose(null);
  }

  #energies() {
    this.energy = Object.fromEntries(ENERGIES.map((name) => [name, element("td")]));
    this.gap = element("td", { title: "kinetic + potential + in strings + dissipated − work, less what it was at first" });
    const rows = ENERGIES.map((name) => element("tr", {}, element("th", { scope: "row" }, WORDS[name]), this.energy[name]));
    this.work = element("p", { class: "quiet" });
    this.parts.energies.append(
      element("table", {}, element("tbody", {}, ...rows, element("tr", { class: "sum" }, element("th", { scope: "row" }, "gap"), this.gap))),
      this.work,
    );
  }

  #method() {
    const { live, model } = this.app;
    const kernel = live.kernel;
    const now = () => model.methods[kernel.field("method")[0]][0];
    const fixed = (method) => method === "rk4" || method === "ros2";
    const options = model.methods.map(([name], i) => element("option", { value: i, selected: name === now() }, name));
    const meaning = element("p", { class: "quiet" });
    const tolerance = slider({
      label: "Tolerance", low: 1e-13, high: 1e-2, log: true, value: kernel.field("tolerance")[0], says: (x) => x.toExponential(0),
      told: (x) => this.app.restartWith({ tolerance: Number(x.toPrecision(2)) }),
    });
    const step = slider({
      label: "Step", low: 5e-5, high: 0.02, log: true, value: 1e-3, says: (x) => `${short(1000 * x)} ms`,
      told: (x) => this.app.restartWith({ max_step: Number(x.toPrecision(3)) }),
    });
    const show = () => {
      meaning.textContent = `${model.methods[kernel.field("method")[0]][1]}.`;
      tolerance.hidden = fixed(now());
      step.hidden = !fixed(now());
    };
    const select = element("select", {
      "aria-label": "Integration method",
      onchange: () => {
        const method = model.methods[Number(select.value)][0];
        this.app.restartWith({ method: Number(select.value), max_step: fixed(method) ? 1e-3 : 0 });
        step.set(1e-3);
        show();
      },
    }, ...options);
    this.setMethod = (name, chosen = 1e-3) => {
      select.value = String(model.methods.findIndex(([other]) => other === name));
      this.app.restartWith({ method: Number(select.value), max_step: fixed(name) ? chosen : 0 });
      step.set(chosen);
      show();
    };
    this.parts.method.append(select, meaning, tolerance, step);
    show();
  }

  #change() {
    const { live, model } = this.app;
    this.factors = FACTORS.filter(([name]) => this.#scene(name).some((value) => value !== 0)).map(([name, label, low, high]) => {
      const log = low > 0;
      const row = slider({ label, low, high, log, value: 1, says: (x) => `× ${x.toFixed(x < 0.1 ? 3 : 2)}`, told: (x) => this.#scale(name, x) });
      row.measure = () => this.#factor(name);
      return row;
    });
    const pull = slider({
      label: "Pull", title: "how hard a drag at a node pulls", low: 0.1, high: 10, log: true, value: 1, says: (x) => `× ${x.toFixed(2)}`,
      told: (x) => (live.strength = x),
    });
    const reset = element("button", { type: "button", onclick: () => this.app.restart(true) }, "As in the scene");
    this.parts.change.append(...this.factors, pull, reset);
    this.memories = new Set(model.memories);
  }

  #scene(name) {
    return [...this.app.live.scene.subarray(...this.model.fields[name])];
  }

  #scale(name, factor) {
    this.#scene(name).forEach((value, place) => {
      if (name !== "stiffness" || !this.memories.has(place)) this.app.live.tune(name, place, factor * value);
    });
    this.app.changed();
  }

  #factor(name) {
    const { live } = this.app;
    const now = live.goal[name] ?? live.kernel.field(name);
    const scene = this.#scene(name);
    const place = scene.findIndex((value, i) => value !== 0 && !(name === "stiffness" && this.memories?.has(i)));
    return place < 0 ? 1 : now[place] / scene[place];
  }

  // Sliders show what is, after a restart or a rewind.
  sync() {
    for (const row of this.factors ?? []) row.set(row.measure());
    this.choose(this.app.chosen);
  }

  // Show a component: {kind, index}, or null.
  choose(what) {
    const place = this.parts.chosen;
    place.replaceChildren();
    this.facts = [];
    if (!what) {
      place.append(element("p", { class: "quiet" }, this.app.live ? "Click a node, string or bar for its numbers; drag a free node to pull it." : "Click a node, string or bar for its numbers."));
      return;
    }
    const { model } = this;
    const name = model[`${what.kind}Names`][what.index];
    place.append(element("h3", {}, `${what.kind} ${name}`));
    const list = element("dl");
    for (const [label, unit, value] of this.#factsOf(what)) {
      const shown = element("dd");
      list.append(element("dt", {}, label), shown);
      this.facts.push([shown, unit, value]);
    }
    place.append(list, ...(this.app.live ? this.#slidersOf(what) : []));
  }

  #factsOf({ kind, index }) {
    const { model } = this;
    const one = (field, place) => (frame) => model.of(frame, field)[place];
    const axes = model.axes.map((axis) => "xyz"[axis]);
    if (kind === "bar") return [["force", "N", one("bar_force", index)], ["length", "m", () => model.barLengths[index]]];
    if (kind === "string") {
      const facts = [["tension", "N", one("string_force", index)], ["of it elastic", "N", one("elastic_force", index)], ["length", "m", one("string_length", index)]];
      const honeycomb = model.nshOf.get(index);
      if (honeycomb !== undefined) facts.push([`snapped of ${model.honeycombs[honeycomb].beams}`, "", (frame) => frame.snapped[honeycomb]]);
      return facts;
    }
    const facts = axes.map((axis, i) => [axis, "m", one("position", axes.length * index + i)]);
    const [list, field, unit] = model.fixed[index] ? [model.grounded, "reaction", "N"] : [model.free, "velocity", "m/s"];
    const place = list.indexOf(index);
    return [...facts, ...axes.map((axis, i) => [`${field} ${axis}`, unit, one(field, axes.length * place + i)])];
  }

  #slidersOf({ kind, index }) {
    const { live, model } = this.app;
    const axes = model.axes.length;
    if (kind === "string") {
      const rows = [["rest_length", "Rest length", "m", 0.8, 1.2], ["stiffness", "Stiffness", "N/m", 0.1, 10], ["damping", "Damping", "N s/m", 0.01, 10]];
      return rows
        .filter(([name]) => this.#scene(name)[index] > 0 && !(name === "stiffness" && this.memories.has(index)) && !(name === "rest_length" && model.actuated.includes(index)))
        .map(([name, label, unit, low, high]) => {
          const scene = this.#scene(name)[index];
          const now = (live.goal[name] ?? live.kernel.field(name))[index];
          return slider({
            label, low: low * scene, high: high * scene, log: true, value: now, says: (x) => `${short(x)} ${unit}`,
            told: (x) => {
              live.tune(name, index, x);
              this.app.changed();
            },
          });
        });
    }
    const place = model.free.indexOf(index);
    if (kind !== "node" || place < 0) return [];
    const most = live.stiffness * model.size * 0.5;
    return model.axes.map((axis, i) =>
      slider({
        label: `Force ${"xyz"[axis]}`, low: -most, high: most, value: live.held[axes * place + i], says: (x) => `${short(Math.abs(x) < most / 300 ? 0 : x)} N`,
        told: (x) => {
          live.held[axes * place + i] = Math.abs(x) < most / 300 ? 0 : x;
          this.app.changed();
        },
      }),
    );
  }

  // Numbers of a frame.  first: the frame that the energies' gap counts from; rate: simulated s per s, null: not running
  show(frame, first, rate) {
    const { model } = this;
    const energy = (of, name) => model.of(of, name)[0];
    const balance = (of) => energy(of, "kinetic") + energy(of, "potential") + energy(of, "elastic") + energy(of, "dissipated") - energy(of, "input_work");
    for (const name of ENERGIES) this.energy[name].textContent = `${short(energy(frame, name))} J`;
    const gap = balance(frame) - balance(first);
    this.gap.textContent = `${short(gap)} J`;
    for (const [place, unit, value] of this.facts) place.textContent = `${short(value(frame))} ${unit}`;
    if (this.app.live) {
      const stats = this.app.live.kernel.stats(model.stats.length);
      const of = (name) => stats[model.stats.indexOf(name)].toLocaleString("en");
      const pace = rate === null ? "" : `, ${rate.toFixed(2)} × real time`;
      this.work.textContent = `${of("steps")} steps, ${of("rejected")} rejected, ${of("transitions")} transitions${pace}`;
    }
    const passed = Math.abs(energy(frame, "potential") - energy(first, "potential")) + energy(frame, "kinetic");
    return gap / Math.max(1e-9, passed, energy(frame, "throughput"), Math.abs(energy(frame, "elastic")));
  }

  // List the last transitions up to a time.
  list(transitions, time, says) {
    let last = transitions.length;
    while (last > 0 && transitions[last - 1].time > time) last--;
    const key = `${last} ${transitions[last - 1]?.time}`;
    if (key === this.listed) return;
    this.listed = key;
    const rows = transitions.slice(Math.max(0, last - 6), last).reverse();
    const items = rows.map((one) => element("li", {}, element("time", {}, `${one.time.toFixed(3)} s`), " ", element("b", {}, this.model.stringNames[one.string]), " ", says(one)));
    const none = this.app.record.told === false ? "the file of the run has none" : "none yet";
    this.parts.events.replaceChildren(...(items.length ? items : [element("li", { class: "quiet" }, none)]));
  }
}
