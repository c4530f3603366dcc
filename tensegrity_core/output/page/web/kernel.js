// The C kernel as a WebAssembly module: one `Kernel` is one simulation.  The calls are those of native/tensegrity.h.

const TRANSITION_BYTES = 32; // ts_transition: two doubles, three int32, padding

export class KernelError extends Error {
  // status: short name of the cause, as in native/errors.def, in small letters; field, place: of a value that is refused, whose
  // name the message goes on from
  constructor(status, message, field = null, place = 0) {
    super(message);
    this.status = status;
    this.field = field;
    this.place = place;
  }
}

export function compile(bytes) {
  return WebAssembly.compile(bytes);
}

export class Kernel {
  #calls;
  #memory;
  #sim;
  #scratch; // for saved states
  #counters;

  // module: see compile; packed: bytes of a packed model; fields, integers: name -> [start, stop] in the blocks of numbers
  constructor(module, packed, fields, integers) {
    this.#calls = new WebAssembly.Instance(module, {}).exports;
    this.#memory = this.#calls.memory;
    this.#calls._initialize();
    this.fields = fields;
    this.integerFields = integers;
    const place = this.#put(packed);
    const message = this.#calls.malloc(256);
    this.#sim = this.#calls.ts_create(place, packed.length, message, 256);
    if (!this.#sim) throw new KernelError("bad_model", this.#text(message));
    this.stateSize = this.#calls.ts_state_size(this.#sim);
    this.#scratch = this.#calls.malloc(this.stateSize);
  }

  // Views of the simulation's memory; made anew at each access, because a memory that grows leaves old views behind.
  get values() {
    return new Float64Array(this.#memory.buffer, this.#calls.ts_values(this.#sim), this.#calls.ts_real_count(this.#sim));
  }
  get integers() {
    return new Int32Array(this.#memory.buffer, this.#calls.ts_integers(this.#sim), this.#calls.ts_integer_count(this.#sim));
  }
  get firstOutput() {
    return this.#calls.ts_output_first(this.#sim);
  }
  get time() {
    return this.#calls.ts_time(this.#sim);
  }

  // View of a field's numbers.
  field(name) {
    if (name in this.fields) return this.values.subarray(...this.fields[name]);
    return this.integers.subarray(...this.integerFields[name]);
  }

  reset() {
    this.#succeed(this.#calls.ts_reset(this.#sim));
  }
  initialize(time = 0) {
    this.#succeed(this.#calls.ts_initialize(this.#sim, time));
  }
  step(h) {
    this.#succeed(this.#calls.ts_step(this.#sim, h));
  }

  // How many transitions the last step had, and the first of them: {time, loss, string, before, after}.
  get transitionCount() {
    return Number(this.#calls.ts_transition_count(this.#sim));
  }
  get transitions() {
    const count = this.#calls.ts_transition_stored(this.#sim);
    const view = new DataView(this.#memory.buffer, this.#calls.ts_transitions(this.#sim), count * TRANSITION_BYTES);
    const all = Array.from({ length: count }, (_, i) => {
      const at = i * TRANSITION_BYTES;
      const [string, before, after] = [16, 20, 24].map((offset) => view.getInt32(at + offset, true));
      return { time: view.getFloat64(at, true), loss: view.getFloat64(at + 8, true), string, before, after };
    });
    return all.filter(({ string }) => string >= 0); // a contact with the ground has none
  }

  // Counters since initialize(), in the order of fields.STATS.
  stats(count) {
    this.#counters ??= this.#calls.malloc(8 * count);
    this.#calls.ts_stats(this.#sim, this.#counters);
    return Array.from(new BigInt64Array(this.#memory.buffer, this.#counters, count), Number);
  }

  save() {
    this.#calls.ts_save(this.#sim, this.#scratch, this.stateSize);
    return new Uint8Array(this.#memory.buffer, this.#scratch, this.stateSize).slice();
  }
  restore(state) {
    new Uint8Array(this.#memory.buffer).set(state, this.#scratch);
    this.#succeed(this.#calls.ts_restore(this.#sim, this.#scratch, state.length));
  }

  #put(bytes) {
    const place = this.#calls.malloc(bytes.length);
    new Uint8Array(this.#memory.buffer).set(bytes, place);
    return place;
  }
  #text(place) {
    const bytes = new Uint8Array(this.#memory.buffer, place);
    return new TextDecoder().decode(bytes.slice(0, bytes.indexOf(0)));
  }
  #succeed(status) {
    if (!status) return;
    const name = this.#text(this.#calls.ts_status_name(status)).toLowerCase();
    const concerned = name === "bad_input" ? this.#calls.ts_concerned(this.#sim) : -1;
    const held = Object.entries(this.fields).find(([, [start, stop]]) => start <= concerned && concerned < stop);
    const [field, [start]] = held ?? [null, [0]];
    throw new KernelError(name, this.#text(this.#calls.ts_message(this.#sim)), field, concerned - start);
  }
}
