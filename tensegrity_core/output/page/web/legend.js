// What the picture's signs mean; it stands beside the picture and covers none of it.

import { element } from "./element.js";
import { short } from "./plots.js";
import { tensionCss } from "./palette.js";

export class Legend {
  constructor(place, app) {
    Object.assign(this, { place, app });
    this.draw();
  }

  draw() {
    const { model, structure } = this.app;
    const stops = Array.from({ length: 9 }, (_, i) => tensionCss(i / 8)).join(", ");
    const bar = element("span", { class: "scale", style: `background: linear-gradient(90deg, ${stops})` });
    const most = short(structure.largest);
    const parts = [
      element("span", { class: "entry" }, "tension 0 ", bar, ` ${most} N or more; wider: more`),
      sign('<path d="M1 3 Q11 12 21 3" stroke-dasharray="4 3"/>', "slack string"),
      sign('<path d="M1 6h20" stroke-width="4" stroke="var(--bar)"/>', "bar"),
    ];
    if (model.honeycombs.length) {
      parts.push(sign('<path d="M7 1h8l4 5-4 5H7L3 6z"/>', "beam of an NSH"), sign('<path d="M7 2h8l5 4-5 4H7L2 6z" fill="currentColor"/>', "snapped"));
    }
    parts.push(sign('<path d="M1 6h13" stroke="var(--force)" stroke-width="3"/><path d="M13 1l8 5-8 5z" fill="var(--force)" stroke="none"/>', "force"));
    if (model.fixed.some(Boolean)) parts.push(sign('<path d="M11 1l8 10H3z" fill="var(--support)" stroke="none"/>', "held"));
    this.place.replaceChildren(...parts);
  }
}

function sign(drawing, text) {
  const made = element("span", { class: "entry" });
  made.innerHTML = `<svg width="22" height="12" viewBox="0 0 22 12" fill="none" stroke="currentColor" stroke-width="1.6" aria-hidden="true">${drawing}</svg>`;
  made.append(` ${text}`);
  return made;
}
