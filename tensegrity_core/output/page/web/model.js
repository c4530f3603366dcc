// What the page was told of a structure, and where a frame keeps its numbers.
//
// A frame is one instant: {time, values, snapped, force}; values: the kernel's outputs in their order; snapped: beams of each NSH
// string that are past their force maximum; force: applied at the free nodes, in the order of the kernel's input, or null.

export class Model {
  constructor(told) {
    Object.assign(this, told);
    this.firstOutput = this.fields.position[0];
    this.size = Math.max(...[0, 1, 2].map((axis) => spread(this.nodes.map((node) => node[axis])))) || 1;
    const members = [...this.barLengths, ...this.startLengths].sort((one, other) => one - other);
    this.member = Math.min(this.size, members[Math.floor(members.length / 2)] ?? this.size); // a usual member's length, m
    this.planar = this.axes.length === 2;
    this.outOfPlane = this.planar ? [0, 1, 2].find((axis) => !this.axes.includes(axis)) : -1;
    this.fixed = this.nodes.map((_, node) => !this.free.includes(node));
    this.nshOf = new Map(this.honeycombs.map((honeycomb, place) => [honeycomb.string, place]));
    this.floor = this.#floor();
  }

  // Height of the ground, m: where the fixed nodes lie at one height and nothing is below; null: there is none.
  #floor() {
    const heights = this.nodes.filter((_, node) => this.fixed[node]).map((node) => node[2]);
    const lowest = Math.min(...this.nodes.map((node) => node[2]));
    const level = heights.length > 0 && spread(heights) === 0 && heights[0] <= lowest;
    return level && this.axes.includes(2) ? heights[0] : null;
  }

  // View of a field of outputs in a frame.
  of(frame, name) {
    const [start, stop] = this.fields[name];
    return frame.values.subarray(start - this.firstOutput, stop - this.firstOutput);
  }

  // (N, 3) m, row by row; along an axis that the scene does not use a node keeps its place.
  positions(frame, out = new Float64Array(3 * this.nodes.length)) {
    const given = this.of(frame, "position");
    const count = this.axes.length;
    this.nodes.forEach((node, n) => {
      for (let axis = 0; axis < 3; axis++) out[3 * n + axis] = node[axis];
      this.axes.forEach((axis, place) => (out[3 * n + axis] = given[count * n + place]));
    });
    return out;
  }

  // Numbers of some nodes' axes as vectors: calls use(node, x, y, z) for each; nodes: in the order of the numbers.
  vectors(numbers, nodes, use) {
    const count = this.axes.length;
    nodes.forEach((node, n) => {
      const vector = [0, 0, 0];
      this.axes.forEach((axis, place) => (vector[axis] = numbers[count * n + place]));
      use(node, ...vector);
    });
  }
}

// Largest less smallest number of a list.
export function spread(numbers) {
  return Math.max(...numbers) - Math.min(...numbers);
}
