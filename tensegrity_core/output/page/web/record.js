// Frames in order of time, with saved states of a live run; the oldest go where they would take too much memory.

const MOST_BYTES = 96e6;

export class Record {
  constructor() {
    this.clear();
  }

  clear() {
    this.frames = [];
    this.states = []; // of the same instants, null: none was kept
    this.transitions = []; // in order of time
    this.bytes = 0;
    this.version = (this.version ?? 0) + 1; // changes where frames vanish
  }

  get start() {
    return this.frames.length ? this.frames[0].time : 0;
  }
  get end() {
    return this.frames.length ? this.frames[this.frames.length - 1].time : 0;
  }

  add(frame, state = null) {
    this.frames.push(frame);
    this.states.push(state);
    this.bytes += size(frame, state);
    if (this.bytes > MOST_BYTES) this.#forget(Math.ceil(this.frames.length / 10));
  }

  // Replace the last frame: one instant has one frame.
  put(frame, state = null) {
    if (this.frames.length && this.end === frame.time) this.cut(this.frames.length - 1);
    this.add(frame, state);
  }

  // Forget this frame and all after it.
  cut(index) {
    for (let i = index; i < this.frames.length; i++) this.bytes -= size(this.frames[i], this.states[i]);
    this.frames.length = this.states.length = index;
    const end = this.end;
    this.transitions = this.transitions.filter((transition) => transition.time <= end);
    this.version++;
  }

  #forget(count) {
    for (let i = 0; i < count; i++) this.bytes -= size(this.frames[i], this.states[i]);
    this.frames.splice(0, count);
    this.states.splice(0, count);
    const start = this.start;
    this.transitions = this.transitions.filter((transition) => transition.time >= start);
    this.version++;
  }

  // Index of the last frame that is not later than a time, the first where there is none.
  at(time) {
    let low = 0;
    let high = this.frames.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.frames[middle].time <= time) low = middle;
      else high = middle - 1;
    }
    return low;
  }
}

function size(frame, state) {
  return frame.values.byteLength + (state ? state.byteLength : 0) + 200;
}
