// element("p", {class: "x", onclick: f}, "text", child ...): a part of the page; names that begin with "on" are listeners.
export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (value !== false && value !== null) made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children.filter((child) => child !== null));
  return made;
}

// A labelled slider with its value in words.  low, high: ends of its range; log: in equal ratios; says: value -> text.
// The returned part has set(value), which tells nobody.
export function slider({ label, title = "", low, high, value, log = false, says, told }) {
  const steps = 400;
  const at = (x) => Math.round(steps * (log ? Math.log(x / low) / Math.log(high / low) : (x - low) / (high - low || 1)));
  const of = (n) => (log ? low * (high / low) ** (n / steps) : low + ((high - low) * n) / steps);
  const shown = element("output", {}, says(value));
  const input = element("input", { type: "range", min: 0, max: steps, step: 1, value: at(value), "aria-label": label });
  const row = element("label", { class: "slider", title }, element("span", {}, label), input, shown);
  const show = (x) => {
    shown.textContent = says(x);
    input.setAttribute("aria-valuetext", says(x));
  };
  input.addEventListener("input", () => {
    show(of(Number(input.value)));
    told(of(Number(input.value)));
  });
  row.set = (x) => {
    input.value = at(x);
    show(x);
  };
  show(value);
  return row;
}
