// Which curves are drawn.

const MOST = 6;

// chosen: {kind, index} or null; returns parts for plots.js.
export function curves(model, chosen) {
  const up = model.axes.includes(2) ? 2 : model.axes[model.axes.length - 1];
  const place = model.axes.indexOf(up);
  const count = model.axes.length;
  const first = (kind, list) => (chosen?.kind === kind ? [chosen.index, ...list.filter((i) => i !== chosen.index)] : list).slice(0, MOST);
  const highest = [...model.free].sort((one, other) => model.nodes[other][up] - model.nodes[one][up]);
  const honeycombs = model.honeycombs.map(({ string }) => string);
  const strings = [...honeycombs, ...model.strings.keys()].filter((string, i, all) => all.indexOf(string) === i);
  const of = (field, at) => (frame) => model.of(frame, field)[at];
  const parts = [
    {
      title: up === 2 ? "Heights" : `Coordinates ${"xyz"[up]}`,
      unit: "m",
      least: 0.04 * model.size,
      series: first("node", highest).map((node) => ({ name: model.nodeNames[node], value: of("position", count * node + place) })),
    },
    {
      title: "Tensions",
      unit: "N",
      least: 0.02 * Math.max(1e-3, model.atStart.tension),
      series: first("string", strings).map((string) => ({ name: model.stringNames[string], value: of("string_force", string) })),
    },
    {
      title: "Energies since the start",
      unit: "J",
      least: 1e-3 * Math.max(1e-3, Math.abs(model.atStart.potential) + Math.abs(model.atStart.elastic)),
      series: ["kinetic", "potential", "elastic", "dissipated", "input_work"].map((field) => ({
        name: field === "input_work" ? "work" : field,
        value: (frame) => model.of(frame, field)[0] - model.atStart[field],
      })),
    },
  ];
  return parts.filter((part) => part.series.length);
}
