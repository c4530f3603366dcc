// What became of a string at a transition, in words.

export function outcome(model, { string, before, after, loss }) {
  if (after === 0 && before !== 0) return "slack";
  if (before === 0 && after !== 0) return "taut";
  const pieces = model.snappedBy[string];
  const [was, is] = [before, after].map((piece) => pieces?.[piece] ?? 0);
  const lost = loss > 0 ? `, ${loss.toPrecision(2)} J lost` : "";
  if (is > was) return `snapped (${is})${lost}`;
  if (is < was) return `returned (${is})${lost}`;
  return `kink${lost}`;
}
