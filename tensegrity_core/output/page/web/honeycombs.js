// Which beams of an NSH have snapped.  The kernel says how many; under one force the weakest snaps first, and the one that holds
// the largest force on its far side returns first.

export class Honeycombs {
  // honeycombs: [{string, beams, rise, fall}], rise and fall: beams in the order in which they snap and return
  constructor(honeycombs) {
    this.honeycombs = honeycombs;
    this.#clear();
  }

  #clear() {
    this.shown = -1; // index of the frame whose beams these are
    this.snapped = this.honeycombs.map(({ beams }) => new Array(beams).fill(false));
  }

  // Take a later frame's counts.
  #follow(counts) {
    this.honeycombs.forEach(({ rise, fall }, place) => {
      const snapped = this.snapped[place];
      let count = snapped.filter(Boolean).length;
      for (const beam of rise) if (count < counts[place] && !snapped[beam]) count += Number((snapped[beam] = true));
      for (const beam of fall) if (count > counts[place] && snapped[beam]) count -= Number(!(snapped[beam] = false));
    });
  }

  // Go to the frame of this index, by all before it; returns for each honeycomb a list of booleans.
  show(record, index) {
    if (index < this.shown || record.version !== this.version) this.#clear();
    this.version = record.version;
    while (this.shown < index) this.#follow(record.frames[++this.shown].snapped);
    return this.snapped;
  }
}
