// The page: reads what stands in it, and keeps picture, curves and numbers at one instant.

import "uplot/dist/uPlot.min.css";
import "./style.css";
import { bytes } from "./encoded.js";
import { Hand } from "./hand.js";
import { Honeycombs } from "./honeycombs.js";
import { compile } from "./kernel.js";
import { Legend } from "./legend.js";
import { Live } from "./live.js";
import { Model } from "./model.js";
import { Overlay } from "./overlay.js";
import { Panel } from "./panel.js";
import { playback } from "./playback.js";
import { Plots } from "./plots.js";
import { curves } from "./curves.js";
import { roundUp } from "./palette.js";
import { Stage } from "./stage.js";
import { Structure } from "./structure.js";
import { Transport } from "./transport.js";
import { outcome } from "./words.js";

const WORK = 14; // ms of simulation in a frame, at most
const SLOWEST = 0.1; // s that one frame may stand for
const LEDGER = 0.01; // share of the energy that has passed, by which a run may miss the balance
const TEXT_EVERY = 100; // ms between updates of numbers and curves
const SELDOM = 250; // ms, where there is no graphics card
const EVERY = 28; // ms between pictures, where there is no graphics card
const REST = 250; // ms without a change, after which a picture is drawn with all pixels
const PERSISTENT = 15; // frames beyond the end of a scale that stretch it

class App {
  constructor(model, live, record) {
    Object.assign(this, { model, live, record });
    this.time = record.start;
    this.playing = false;
    this.following = true; // the end of a live run
    this.speed = 1;
    this.names = 0;
    this.show = { forces: true, reactions: false };
    this.chosen = null;
    this.stale = true;
    this.push = 0; // the largest force so far, N
    this.spent = []; // ms of work in the last frames
    this.intervals = []; // ms between them
    this.honeycombs = new Honeycombs(model.honeycombs);
    const canvas = document.getElementById("stage");
    this.stage = new Stage(canvas, model);
    this.structure = new Structure(this.stage, model);
    this.overlay = new Overlay(document.getElementById("overlay"), this.stage, this.structure, model);
    this.stage.controls.addEventListener("change", () => (this.stale = true));
    const pull = (node, target) => {
      this.hint("");
      live.pull = { node, target };
      this.play(true);
    };
    const release = () => {
      live.pull = null;
      this.changed();
    };
    this.hand = new Hand(canvas, this.stage, this.structure, model, { choose: (what) => this.choose(what), pull: live && pull, release });
    this.plots = new Plots(document.getElementById("plots"), record, { seek: (time) => this.seek(time) }, this.stage.software);
    this.plots.window = live ? 10 : null;
    this.panel = new Panel(this);
    this.transport = new Transport(this);
    this.legend = new Legend(document.getElementById("legend"), this);
    this.plots.set(curves(model, null));
    this.#scale();
    this.hint(live ? "Drag a node to pull it" : "");
    new ResizeObserver(() => (this.stale = true)).observe(canvas);
  }

  // Play or stop; a live run goes on from the instant that is shown.
  play(on = !this.playing) {
    if (on && this.live && this.time < this.record.end) {
      this.live.rewind(this.time);
      this.time = this.record.end;
      this.panel.sync();
    }
    if (on && !this.live && this.time >= this.record.end) this.time = this.record.start;
    if (on && this.live?.failure) return;
    this.playing = on;
    this.stale = true;
  }

  seek(time) {
    this.playing = false;
    this.time = Math.max(this.record.start, Math.min(this.record.end, time));
    this.stale = true;
  }

  // Frames forwards or backwards.
  nudge(count) {
    const index = this.record.at(this.time) + count;
    if (this.live && index >= this.record.frames.length) {
      for (let i = 0; i < count; i++) this.live.advance(1 / 60, WORK);
      this.playing = false;
      this.time = this.record.end;
    } else this.seek(this.record.frames[Math.max(0, Math.min(this.record.frames.length - 1, index))].time);
    this.stale = true;
  }

  restart(everything = false) {
    if (!this.live) return this.seek(this.record.start);
    this.live.restart(everything);
    this.#begun();
  }

  // Start anew with other options of the integrator.
  restartWith(options) {
    this.live.choose(options);
    this.#begun();
  }

  #begun() {
    this.time = this.record.start;
    this.warned = false;
    this.structure.largest = this.push = 0;
    this.#scale();
    this.panel.sync();
    this.say("");
    this.stale = true;
  }

  changed() {
    this.stale = true;
  }

  choose(what) {
    this.chosen = what;
    this.panel.choose(what);
    this.plots.set(curves(this.model, what));
    this.plots.update(this.time, this.record.at(this.time));
    this.stale = true;
  }

  recolour() {
    this.stage.recolour();
    this.structure.recolour();
    this.plots.rebuild();
    this.legend.draw();
    this.stale = true;
  }

  // What can be done, at the foot of the picture.
  hint(text) {
    const place = document.getElementById("hint");
    place.hidden = !text;
    place.textContent = text;
  }

  // A line over the picture; a button beside it, where something can be done.
  say(text, button = null) {
    const place = document.getElementById("notice");
    place.hidden = !text;
    place.replaceChildren(text);
    if (button) {
      const made = document.createElement("button");
      made.textContent = button[0];
      made.onclick = button[1];
      place.append(" ", made);
    }
  }

  // The ends of the scales of tensions and of arrows, after more frames: blows that pass in a moment do not stretch them.
  #scale(frames = this.record.frames) {
    const { model, structure } = this;
    const tensions = frames.map((frame) => Math.max(0, ...model.of(frame, "string_force")));
    if (!structure.largest) this.over = [];
    this.over.push(...tensions.filter((tension) => tension > structure.largest));
    if (!structure.largest || this.over.length > PERSISTENT) {
      const sorted = this.over.sort((one, other) => one - other);
      structure.largest = Math.max(structure.largest, roundUp(sorted[Math.floor(0.95 * (sorted.length - 1))] ?? 0));
      this.over = [];
      this.legend.draw();
    }
    const count = model.axes.length;
    for (const { force } of frames) {
      for (let i = 0; force && i < force.length; i += count) this.push = Math.max(this.push, Math.hypot(...force.subarray(i, i + count)));
    }
    this.arrowScale = (0.28 * model.size) / Math.max(this.push, 0.5 * structure.largest);
  }

  tick(now) {
    requestAnimationFrame((next) => this.tick(next));
    const begun = performance.now();
    const passed = Math.min(SLOWEST, Math.max(0, (now - (this.last ?? now)) / 1000));
    this.last = now;
    if (this.playing) this.#advance(passed);
    const resting = !this.playing && !this.stale && !this.overlay.busy;
    if (resting && (this.still || now - this.drawn < REST)) return;
    if (this.stage.software && now - this.drawn < EVERY) return;
    this.still = resting;
    this.stale = false;
    const index = this.record.at(this.time);
    const frame = this.record.frames[index];
    this.#draw(frame, index, now);
    if (now - (this.told ?? -Infinity) > (this.stage.software ? SELDOM : TEXT_EVERY) || !this.playing) this.#tell(frame, index, now);
    const time = performance.now() - begun;
    this.spent.push(time);
    if (this.spent.length > 240) this.spent.shift();
  }

  #advance(passed) {
    this.stale = true;
    if (!this.live) {
      this.time += passed * this.speed;
      if (this.time >= this.record.end) [this.time, this.playing] = [this.record.end, false];
      return;
    }
    const before = this.record.transitions.length;
    const frames = this.record.frames.length;
    const done = this.live.advance(passed * this.speed, WORK);
    this.pace = passed > 0 ? 0.9 * (this.pace ?? this.speed) + (0.1 * done) / passed : this.pace;
    this.time = this.record.end;
    this.#scale(this.record.frames.slice(frames));
    for (const one of this.record.transitions.slice(before)) {
      const text = outcome(this.model, one);
      if (text !== "kink") this.overlay.flash(one.string, text, this.last / 1000);
    }
    if (this.live.failure) this.#failed();
  }

  #failed() {
    this.playing = false;
    const { status, message, time } = this.live.failure;
    const method = this.model.methods[this.live.kernel.field("method")[0]][0];
    const blown = status === "unstable" || status === "not_finite";
    const step = this.live.kernel.field("max_step")[0] * 1000;
    const text = blown
      ? `${method} with a step of ${step} ms has exploded at t = ${time.toFixed(3)} s: the step is too long for this motion. Take a shorter one, or another method.`
      : `The simulation stopped at t = ${time.toFixed(3)} s: ${message}.`;
    this.say(text, ["Start again", () => this.restart()]);
  }

  #draw(frame, index, now) {
    this.honeycombs.show(this.record, index);
    this.structure.restLengths = this.live ? this.live.kernel.field("rest_length") : this.model.restLengths;
    const seen = { snapped: this.honeycombs.snapped, chosen: this.chosen, arrowScale: this.arrowScale, pulled: this.live?.pull?.node };
    this.structure.update(frame, { ...this.show, ...seen });
    this.stage.draw(this.interval(now), this.still);
    const pull = this.live?.pull && { ...this.live.pull, force: this.#pulling(frame) };
    this.overlay.draw(now / 1000, this.names, this.chosen, pull);
  }

  #pulling(frame) {
    const count = this.model.axes.length;
    const place = this.model.free.indexOf(this.live.pull.node);
    return Math.hypot(...frame.force.subarray(count * place, count * place + count));
  }

  // Time between frames, ms, smoothed.
  interval(now) {
    const passed = now - (this.drawn ?? now);
    this.drawn = now;
    this.intervals.push(passed);
    if (this.intervals.length > 240) this.intervals.shift();
    return passed > 0 && passed < 500 ? passed : 0;
  }

  #tell(frame, index, now) {
    this.told = now;
    this.transport.show(this.time);
    this.plots.update(this.time, index);
    const off = this.panel.show(frame, this.record.frames[0], this.playing && this.live ? (this.pace ?? null) : null);
    this.panel.list(this.record.transitions, this.time, (one) => outcome(this.model, one));
    if (Math.abs(off) > LEDGER && this.live && !this.live.failure && !this.warned) {
      this.warned = true;
      const method = this.model.methods[this.live.kernel.field("method")[0]][0];
      this.say(`The energies no longer add up: ${method} is too coarse here. What you see is not the motion of this structure.`, ["Start again", () => this.restart()]);
    }
  }
}

async function begin() {
  const told = JSON.parse(document.getElementById("model").textContent);
  const model = new Model(told);
  let live = null;
  let record = null;
  if (told.run) record = await playback(model, told.run);
  else {
    const module = await compile(await bytes(document.getElementById("kernel").textContent));
    live = new Live(model, module, await bytes(told.packed));
    record = live.record;
  }
  const app = new App(model, live, record);
  window.tensegrity = app; // for tests, and for whoever looks behind the page
  document.documentElement.dataset.ready = "yes";
  requestAnimationFrame((now) => app.tick(now));
  if (!window.matchMedia("(prefers-reduced-motion: reduce)").matches) app.play(true);
}

begin().catch((error) => {
  const place = document.getElementById("notice");
  place.hidden = false;
  place.textContent = `This page cannot run here: ${error.message}`;
  document.documentElement.dataset.ready = "no";
  console.error(error);
});
