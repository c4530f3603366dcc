// Runs the page's kernel under node: `node page_kernel.mjs MODULE JOBS OUT`.  JOBS: a JSON list of runs, each with the packed model,
// the places of its fields, its options, lengths of steps and inputs; OUT: all values after each step, run by run, then the times of
// all transitions, as doubles; what else there is to tell is printed as JSON.
import { readFileSync, writeFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const [, , web, moduleFile, jobsFile, outFile] = process.argv;
const { Kernel, compile } = await import(pathToFileURL(web));
const module = await compile(readFileSync(moduleFile));
const rows = [];
const told = [];
for (const job of JSON.parse(readFileSync(jobsFile))) {
  const kernel = new Kernel(module, Buffer.from(job.packed, "base64"), job.fields, job.integers);
  const given = job.rows.map((row) => Float64Array.from(row));
  kernel.field("method")[0] = job.method;
  kernel.field("tolerance")[0] = job.tolerance;
  kernel.field("max_step")[0] = job.max_step;
  kernel.values.set(given[0]);
  kernel.initialize(job.start);
  rows.push(kernel.values.slice());
  const transitions = [];
  const snapped = [];
  job.steps.forEach((h, k) => {
    kernel.values.set(given[k]);
    kernel.step(h);
    rows.push(kernel.values.slice());
    transitions.push(...kernel.transitions);
    snapped.push([...kernel.field("snapped")]);
  });
  const stats = [...kernel.stats(job.stats)];
  const before = kernel.values.slice();
  const saved = kernel.save();
  kernel.step(job.steps[0]);
  const ahead = kernel.values.slice();
  kernel.restore(saved);
  const back = kernel.values.every((value, i) => value === before[i]);
  kernel.step(job.steps[0]);
  const again = kernel.values.every((value, i) => value === ahead[i]);
  let refused = null;
  const time = kernel.time;
  kernel.field("rest_length_rate")[1] = -1e6;
  try {
    kernel.step(job.steps[0]);
  } catch ({ status, field, place, message }) {
    refused = { status, field, place, message };
  }
  told.push({ transitions, snapped, restored: back && again, stats, time, refused });
}
const all = new Float64Array(rows.reduce((sum, row) => sum + row.length, 0));
let at = 0;
for (const row of rows) {
  all.set(row, at);
  at += row.length;
}
writeFileSync(outFile, new Uint8Array(all.buffer));
console.log(JSON.stringify(told));
