// Curves over time, with a cursor at the instant that is shown.

import uPlot from "uplot";
import { css, curve } from "./palette.js";

const MOST_POINTS = 600;

export class Plots {
  // parts: [{title, unit, least, series: [{name, value(frame)}]}], least: span of the axis; told: {seek(time)}
  constructor(place, record, told, software) {
    Object.assign(this, { place, record, told, software });
    this.charts = [];
    this.window = null; // s shown of a live run, null: all
  }

  // Show other curves.
  set(parts) {
    this.parts = parts;
    this.rebuild();
  }

  rebuild() {
    for (const { chart } of this.charts) chart.destroy();
    this.place.replaceChildren();
    this.charts = this.parts.map((part) => this.#chart(part));
    this.seen = -1;
  }

  #chart(part) {
    const box = document.createElement("figure");
    const caption = document.createElement("figcaption");
    caption.textContent = part.title;
    const unit = document.createElement("span");
    unit.textContent = part.unit;
    caption.append(" ", unit);
    const place = document.createElement("div");
    const legend = document.createElement("div");
    legend.className = "legend";
    box.append(caption, place, legend);
    this.place.append(box);
    const values = part.series.map((one, i) => legendEntry(legend, one.name, curve(i)));
    const axis = { stroke: css("--ink-soft"), grid: { stroke: css("--rule"), width: 1 }, ticks: { show: false }, font: "11px system-ui" };
    const chart = onProcessor(this.software, () => new uPlot(
      {
        width: place.clientWidth || 300,
        height: 120,
        legend: { show: false },
        cursor: { x: false, y: false, points: { show: false }, drag: { setScale: false, x: false, y: false } },
        scales: { x: { time: false }, y: { range: (_, low, high) => roomy(low, high, part.least) } },
        padding: [6, 8, 0, 0],
        axes: [{ ...axis, size: 22, space: 50 }, { ...axis, size: 52, space: 26, values: (_, ticks) => ticks.map(short) }],
        series: [{}, ...part.series.map((one, i) => ({ label: one.name, stroke: curve(i)[0], width: 1.6, dash: curve(i)[1], points: { show: false } }))],
        hooks: { draw: [(u) => this.#drawMarks(u)] },
      },
      [[], ...part.series.map(() => [])],
      place,
    ));
    chart.over.addEventListener("pointerdown", (event) => {
      const seek = (e) => this.told.seek(chart.posToVal(e.clientX - chart.over.getBoundingClientRect().left, "x"));
      seek(event);
      chart.over.setPointerCapture(event.pointerId);
      chart.over.onpointermove = seek;
      chart.over.onpointerup = () => (chart.over.onpointermove = null);
    });
    return { chart, part, values, place };
  }

  // Lines at transitions and at the instant that is shown.
  #drawMarks(u) {
    const pen = u.ctx;
    const { left, top, width, height } = u.bbox;
    const line = (time, colour, wide, dash) => {
      const x = u.valToPos(time, "x", true);
      if (!(x >= left - 1 && x <= left + width + 1)) return;
      pen.strokeStyle = colour;
      pen.lineWidth = wide;
      pen.setLineDash(dash);
      pen.beginPath();
      pen.moveTo(x, top);
      pen.lineTo(x, top + height);
      pen.stroke();
    };
    pen.save();
    for (const { time } of this.record.transitions.slice(-400)) line(time, css("--mark"), 1, [2, 4]);
    if (this.time !== undefined) line(this.time, css("--ink"), 1.5, []);
    pen.restore();
  }

  // time: of the cursor, s; index: of the frame there
  update(time, index) {
    this.time = time;
    const { frames } = this.record;
    if (!frames.length) return;
    const from = this.window === null ? 0 : this.record.at(Math.max(this.record.start, Math.min(time, this.record.end) - this.window));
    const to = this.window === null ? frames.length - 1 : Math.min(frames.length - 1, Math.max(index, this.record.at(frames[from].time + this.window)));
    const step = Math.max(1, Math.ceil((to - from + 1) / MOST_POINTS));
    const rows = [];
    for (let i = from - (from % step); i <= to; i += step) if (i >= 0) rows.push(frames[i]);
    if (rows[rows.length - 1] !== frames[to]) rows.push(frames[to]);
    for (const { chart, part, values, place } of this.charts) {
      if (place.clientWidth && place.clientWidth !== chart.width) chart.setSize({ width: place.clientWidth, height: 120 });
      chart.setData([rows.map((frame) => frame.time), ...part.series.map((one) => rows.map(one.value))]);
      part.series.forEach((one, i) => (values[i].textContent = short(one.value(frames[index]))));
    }
  }
}

function legendEntry(legend, name, [colour, dash]) {
  const entry = document.createElement("span");
  entry.innerHTML = `<svg width="22" height="8" aria-hidden="true"><line x1="0" y1="4" x2="22" y2="4" stroke="${colour}" stroke-width="2" stroke-dasharray="${dash.join(" ")}"/></svg>`;
  const value = document.createElement("b");
  entry.append(name, " ", value);
  legend.append(entry);
  return value;
}

// Call a function whose canvases are drawn by the processor itself, where a graphics card would be played by it anyway.
function onProcessor(software, make) {
  const usual = HTMLCanvasElement.prototype.getContext;
  if (software) HTMLCanvasElement.prototype.getContext = function (kind, options) {
    return usual.call(this, kind, { ...options, willReadFrequently: true });
  };
  try {
    return make();
  } finally {
    HTMLCanvasElement.prototype.getContext = usual;
  }
}

// A range of at least this span around the numbers, with room above and below.
function roomy(low, high, least) {
  if (!Number.isFinite(low) || !Number.isFinite(high)) return [0, least];
  const room = Math.max(0.08 * (high - low), 0.5 * (least - (high - low)));
  return [low - room, high + room];
}

// A number in at most five letters or so.
export function short(value) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size < 1e-12) return "0";
  if (size >= 1e5 || size < 1e-3) return value.toExponential(1).replace("e+", "e");
  return String(Number(value.toPrecision(size >= 100 ? 4 : 3)));
}
