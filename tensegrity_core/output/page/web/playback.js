// A run that was made before, as a record.

import { doubles, floats } from "./encoded.js";
import { Record } from "./record.js";

// run: {times, values, snapped, force, transitions}, each but the last an encoded block of numbers, row by row.
export async function playback(model, run) {
  const [times, values, snapped, force] = await Promise.all([
    doubles(run.times),
    floats(run.values),
    floats(run.snapped),
    run.force ? floats(run.force) : null,
  ]);
  const record = new Record();
  const part = (block, row) => block.subarray((row * block.length) / times.length, ((row + 1) * block.length) / times.length);
  times.forEach((time, row) => {
    record.add({ time, values: part(values, row), snapped: part(snapped, row), force: force && part(force, row) });
  });
  record.told = run.transitions !== null; // whether the file of the run had transitions
  record.transitions = (run.transitions ?? []).map(([time, string, before, after, loss]) => ({ time, string, before, after, loss }));
  return record;
}
