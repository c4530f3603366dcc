// Which beams of an NSH have snapped.  The kernel says how many; under one force the weakest snaps first, and the one that holds
// the largest force on its far side returns first.

export class Honeycombs {
  // honeycombs: [{string, beams, rise, fall}], rise and fall: beams in the order in which they snap and return
  constructor(honeycombs) {
    this.honeycombs = honeycombs;
    this.clear();
  }

  clear() {
    this.snapped = this.honeycombs.map(({ beams }) => new Array(beams).fill(false));
  }

  // Take a later frame's counts; returns for each honeycomb a list of booleans.
  follow(counts) {
    this.honeycombs.forEach(({ rise, fall }, place) => {
      const snapped = this.snapped[place];
      let count = snapped.filter(Boolean).length;
      for (const beam of rise) if (count < counts[place] && !snapped[beam]) count += Number((snapped[beam] = true));
      for (const beam of fall) if (count > counts[place] && snapped[beam]) count -= Number(!(snapped[beam] = false));
    });
    return this.snapped;
  }

  // After frames were passed over: from the first of the record up to this one.
  replay(frames, last) {
    this.clear();
    for (let i = 0; i <= last; i++) this.follow(frames[i].snapped);
    return this.snapped;
  }
}
