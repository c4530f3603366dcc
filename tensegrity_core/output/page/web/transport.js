// Play, slider, clock and keys.

const SPEEDS = [0.02, 0.05, 0.1, 0.25, 0.5, 1, 2, 4];
const KEYS = [
  ["space", "play or stop"],
  ["← →", "a frame back or forth"],
  ["Home, End", "first or last instant"],
  ["r", "start again"],
  ["n", "names: nodes, all, none"],
  ["g", "reactions of the ground"],
  ["0", "view on the whole structure"],
  ["− +", "slower or faster"],
  ["t", "light or dark"],
  ["Esc", "choose nothing"],
];

export class Transport {
  constructor(app) {
    this.app = app;
    const find = (id) => document.getElementById(id);
    this.button = find("play");
    this.slider = find("time");
    this.clock = find("clock");
    this.speed = find("speed");
    this.button.onclick = () => app.play();
    find("again").onclick = () => app.restart();
    find("names").onclick = () => this.#names();
    find("whole").onclick = () => this.#home();
    find("theme").onclick = () => this.#theme();
    this.slider.oninput = () => app.seek(app.record.start + Number(this.slider.value) * (app.record.end - app.record.start));
    for (const speed of SPEEDS) this.speed.append(new Option(`${speed} ×`, speed, false, speed === 1));
    this.speed.onchange = () => this.#setSpeed(Number(this.speed.value));
    const help = find("keys");
    for (const [key, meaning] of KEYS) {
      const term = document.createElement("dt");
      term.textContent = key;
      const text = document.createElement("dd");
      text.textContent = meaning;
      help.append(term, text);
    }
    document.addEventListener("keydown", (event) => this.#key(event));
  }

  show(time) {
    const { app } = this;
    const length = app.record.end - app.record.start;
    this.slider.value = length > 0 ? (time - app.record.start) / length : 0;
    this.slider.setAttribute("aria-valuetext", `${time.toFixed(3)} s`);
    this.clock.textContent = `${time.toFixed(2)} s`;
    this.button.setAttribute("aria-label", app.playing ? "Stop" : "Play");
    this.button.dataset.playing = app.playing;
  }

  #setSpeed(speed) {
    this.app.speed = speed;
    this.app.pace = undefined;
    this.speed.value = speed;
  }

  #names() {
    this.app.names = (this.app.names + 1) % 3;
    document.getElementById("names").setAttribute("aria-pressed", this.app.names > 0);
    this.app.changed();
  }

  #home() {
    this.app.stage.home();
    this.app.changed();
  }

  #theme() {
    const root = document.documentElement;
    root.dataset.theme = root.dataset.theme === "dark" ? "light" : "dark";
    this.app.recolour();
  }

  #key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("select, input:not(#time)")) return;
    const { app } = this;
    const at = SPEEDS.indexOf(app.speed);
    const actions = {
      " ": () => app.play(),
      ArrowLeft: () => app.nudge(event.shiftKey ? -10 : -1),
      ArrowRight: () => app.nudge(event.shiftKey ? 10 : 1),
      Home: () => app.seek(app.record.start),
      End: () => app.seek(app.record.end),
      r: () => app.restart(),
      n: () => this.#names(),
      g: () => {
        app.show.reactions = !app.show.reactions;
        app.changed();
      },
      0: () => this.#home(),
      "-": () => this.#setSpeed(SPEEDS[Math.max(0, at - 1)]),
      "+": () => this.#setSpeed(SPEEDS[Math.min(SPEEDS.length - 1, at + 1)]),
      t: () => this.#theme(),
      Escape: () => app.choose(null),
    };
    if (!(event.key in actions) || (event.key === " " && event.target.closest("button, summary"))) return;
    event.preventDefault();
    actions[event.key]();
  }
}
