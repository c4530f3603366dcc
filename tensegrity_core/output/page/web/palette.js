// Colours: of the page's parts, from its style sheet, and of tensions, on a scale that colour-blind eyes can follow.

import { Color, SRGBColorSpace } from "three";

// Matplotlib's plasma, of which each theme takes the part that stands out from its ground.
const PLASMA = ["#0d0887", "#41049d", "#6a00a8", "#8f0da4", "#b12a90", "#cc4778", "#e16462", "#f2844b", "#fca636", "#fcce25", "#f0f921"];
const PART = { light: [0.02, 0.78], dark: [0.3, 0.95] };

// Colours of curves, after Okabe and Ito, and how curves are dashed.
const CURVES = {
  light: ["#0072b2", "#d55e00", "#009e73", "#b0487f", "#56b4e9", "#c98a00"],
  dark: ["#56b4e9", "#f0894a", "#35c99a", "#e29ac2", "#9fd3f2", "#e6b84a"],
};
const DASHES = [[], [9, 4], [3, 3], [12, 3, 3, 3], [6, 6], [2, 5]];

// Colour and dashes of the curve of this number.
export function curve(number) {
  const place = number % DASHES.length;
  return [CURVES[theme()][place], DASHES[place]];
}

export function theme() {
  return document.documentElement.dataset.theme;
}

export function css(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

// The colour of a share of the scale, 0 to 1, as numbers 0 to 1 of sRGB.
export function tensionRgb(share) {
  const [low, high] = PART[theme()] ?? PART.light;
  const at = (low + (high - low) * Math.max(0, Math.min(1, share))) * (PLASMA.length - 1);
  const below = Math.min(PLASMA.length - 2, Math.floor(at));
  const [one, other] = [PLASMA[below], PLASMA[below + 1]].map(parts);
  return one.map((value, i) => value + (other[i] - value) * (at - below));
}

const made = new Color();
export function tensionColor(share) {
  return made.setRGB(...tensionRgb(share), SRGBColorSpace);
}

export function tensionCss(share) {
  return `rgb(${tensionRgb(share).map((value) => Math.round(255 * value)).join(" ")})`;
}

function parts(hex) {
  return [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255);
}

// The smallest of 1, 2, 5, 10 ... that is not smaller.
export function roundUp(value) {
  if (!(value > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 5, 10].map((step) => step * power).find((step) => step >= value * (1 - 1e-9));
}
