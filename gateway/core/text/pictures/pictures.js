"use strict";
// Pictures of quantities over time, one wheel a colour: what the live page and the pages of drives draw alike.
const pictures = (() => {
  const COLOURS = 8, DASHES = [[], [6, 4], [12, 3, 4, 3], [17, 5]], DOTTED = [1.5, 4];
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const colourOf = (i) => css(`--w${i % COLOURS}`);
  const faint = (colour) => `${colour}33`;
  const axis = () => ({ stroke: css("--ink"), grid: { stroke: css("--line"), width: 1 }, ticks: { stroke: css("--line") } });
  // The width of an axis: that of its longest number, and at least so many px that pictures stand in line.
  const widthFrom = (least) => (u, values, index, cycle) => {
    const { font, gap, ticks, _size: known } = u.axes[index];
    if (cycle > 1) return known;
    [u.ctx.font] = font;
    const widest = Math.max(0, ...(values || []).map((text) => u.ctx.measureText(text ?? "").width / devicePixelRatio));
    return Math.max(least, Math.ceil(widest + ticks.size + gap));
  };
  const dashOf = (i) => DASHES[i % DASHES.length];
  // No wheel is dotted: that is what is provisional.
  // A wheel has four series: valid, provisional, and the limits of one standard error about both.
  const seriesOf = (i, { isPrinted = false } = {}) => {
    const stroke = colourOf(i), none = { stroke: "transparent", points: { show: false } };
    return [
      { stroke, width: 2, dash: isPrinted ? dashOf(i) : [], points: { show: false } },
      { stroke, width: isPrinted ? 1.5 : 2, dash: DOTTED, points: { show: false } },
      none,
      none,
    ];
  };
  const bandsOf = (wheels) => wheels.map((i, at) => ({ series: [4 * at + 3, 4 * at + 4], fill: faint(colourOf(i)) }));
  // The four columns of a wheel at one time; undefined is drawn through, null is a gap.
  const cellsOf = (value, error, isProvisional) => [
    value !== null && !isProvisional ? value : null,
    value !== null && isProvisional ? value : null,
    value !== null && error !== null ? value + error : null,
    value !== null && error !== null ? value - error : null,
  ];
  const digitsOf = (error) => Math.max(0, Math.min(6, 1 - Math.floor(Math.log10(error))));
  // Wear below zero by less than twice its error is none, as in `plain_wear`.
  const plain = (value, error, name) => (name === "wear_mm" && value < 0 && error && value > -2 * error ? 0 : value);
  const written = (raw, error, unit, isProvisional, name = "") => {
    const value = plain(raw, error, name);
    return `${error ? value.toFixed(digitsOf(error)) : Number(value.toPrecision(4))}${error ? ` ± ${error.toFixed(digitsOf(error))}` : ""}${unit ? ` ${unit}` : ""}${isProvisional ? " ~" : ""}`;
  };
  // The piece of line that stands beside the name of a wheel.
  const key = (i, dash) => {
    const box = document.createElement("span");
    // Nothing in it comes from outside: an index, and a colour of the style sheet.
    box.innerHTML = `<svg class="key" aria-hidden="true" viewBox="0 0 26 6"><line x1="0" x2="26" y1="3" y2="3" stroke="${colourOf(i)}" stroke-width="3" stroke-dasharray="${dash.join(" ")}"/></svg>`;
    return box.firstChild;
  };
  return { DOTTED, axis, bandsOf, cellsOf, colourOf, css, dashOf, faint, key, seriesOf, widthFrom, written };
})();
